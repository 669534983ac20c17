// bigsContractView (appearance/bigs/bigs.h): one fragment per (splat, i), a_i = sum_j c_ij y_j(w_o).
uniform sampler2D uGeometry;     // slot 0: mean, opacity
uniform sampler2DArray uScatter; // c_ij rgb
uniform vec3 uCameraAsset;

layout(location = 0) out vec4 outContracted;

vec3 scatter(int texel)
{
    int row = texel >> SCATTER_SHIFT, mask = (1 << SCATTER_SHIFT) - 1;
    return texelFetch(uScatter, ivec3(texel & mask, row & mask, row >> SCATTER_SHIFT), 0).rgb;
}

void main()
{
    int gridRow = int(gl_FragCoord.y / float(S_FUNCTIONS));
    ivec2 splat = ivec2(gl_FragCoord.x, gridRow);
    int i = int(gl_FragCoord.y) - gridRow * S_FUNCTIONS; // inverse of contractedTexel
    vec3 d = uCameraAsset - texelFetch(uGeometry, splat, 0).xyz;
    float r2 = dot(d, d);
    float y[25];
    shBasis(S_FUNCTIONS, r2 > 1e-20 ? d * inversesqrt(r2) : vec3(0.0, 0.0, 1.0), y);
    vec3 a = vec3(0.0);
    int texel = (splat.x + WIDTH * splat.y) * (S_FUNCTIONS * (S_FUNCTIONS + 1) / 2) + i * (i + 1) / 2;
    for (int j = 0; j < S_FUNCTIONS; ++j) {
        a += scatter(texel) * y[j];
        texel += j < i ? 1 : j + 1; // to bigsPair(i, j + 1)
    }
    outContracted = vec4(a, 0.0);
}
