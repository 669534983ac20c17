// bigsContractView (appearance/bigs/bigs.h): one fragment per (splat, i), a_i = sum_j c_ij y_j(w_o).
uniform sampler2D uGeometry;      // slot 0: mean, opacity
uniform sampler2DArray uScatter;  // slot pair(i, j): c_ij rgb
uniform vec3 uCameraAsset;

layout(location = 0) out vec4 outContracted;

vec3 scatter(ivec2 splat, int pair)
{
    return texelFetch(uScatter, ivec3(slotTexel(splat, pair & ((1 << SLOT_SHIFT) - 1)), pair >> SLOT_SHIFT), 0).rgb;
}

void main()
{
    ivec2 splat = passSplat();
    int i = passSlot();
    vec3 d = uCameraAsset - texelFetch(uGeometry, splat, 0).xyz;
    float r2 = dot(d, d);
    float y[25];
    shBasis(S_FUNCTIONS, r2 > 1e-20 ? d * inversesqrt(r2) : vec3(0.0, 0.0, 1.0), y);
    vec3 a = vec3(0.0);
    int row = i * (i + 1) / 2;
    for (int j = 0; j < S_FUNCTIONS; ++j) a += scatter(splat, j <= i ? row + j : j * (j + 1) / 2 + i) * y[j];
    outContracted = vec4(a, 0.0);
}
