// bigsContractView (appearance/bigs/bigs.h): one fragment per (splat, i), a_i = sum_j c_ij y_j(w_o), of the first uScattering splats.
uniform sampler2D uGeometry;     // slot 0: mean, opacity
uniform sampler2DArray uScatter; // c_ij rgb
uniform vec4 uCamera;
uniform int uScattering;

layout(location = 0) out vec4 outContracted;

void main()
{
    int gridRow = int(gl_FragCoord.y / float(S_FUNCTIONS));
    ivec2 splat = ivec2(int(gl_FragCoord.x), gridRow);
    int i = int(gl_FragCoord.y) - gridRow * S_FUNCTIONS; // inverse of contractedTexel
    if (splatIndex(splat) >= uScattering) discard;
    float y[25];
    shBasis(S_FUNCTIONS, directionToCamera(uCamera, texelFetch(uGeometry, splat, 0).xyz), y);
    vec3 a = vec3(0.0);
    int texel = splatIndex(splat) * (S_FUNCTIONS * (S_FUNCTIONS + 1) / 2) + i * (i + 1) / 2;
    for (int j = 0; j < S_FUNCTIONS; ++j) {
        a += texelFetch(uScatter, longRowTexel(texel), 0).rgb * y[j];
        texel += j < i ? 1 : j + 1; // to bigsPair(i, j + 1)
    }
    outContracted = vec4(a, 0.0);
}
