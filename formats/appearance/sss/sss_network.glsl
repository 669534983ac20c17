// GLSL twin of sssNetworkLight (appearance/sss/sss_network.h). Features go four to a vec4; weight texel (first + rows * j + i) holds
// what four outputs 4j..4j+3 take from input i (packNetwork in runtime/src/sss_gpu.cpp), and a row of biases comes before them.
// INPUTS, H1 to HS: sizes of the layers; AT_*: where each layer begins. Without HAS_SHARE, for weights of 0 there, the share is 1.
uniform sampler2D uWeights;

vec4 weight(int texel) { return texelFetch(uWeights, ivec2(texel & 1023, texel >> 10), 0); }
vec4 leaky(vec4 x) { return max(x, LEAK * x); }
vec4 logistic(vec4 x) { return 1.0 / (1.0 + exp(-clamp(x, -80.0, 80.0))); }

// sum of four inputs x into the four outputs of column block `at`
vec4 take(int at, vec4 x) { return weight(at) * x.x + weight(at + 1) * x.y + weight(at + 2) * x.z + weight(at + 3) * x.w; }

// `h`: the part of the first layer that does not depend on light and view; x0, x1: the eight inputs that do. residual rgb, share.
vec4 sssNetwork(vec4 h[H1 / 4], vec4 x0, vec4 x1)
{
    vec4 h2[H2 / 4], h3[H3 / 4];
    for (int j = 0; j < H1 / 4; ++j) h[j] = leaky(h[j] + take(AT_LIGHT + 8 * j, x0) + take(AT_LIGHT + 8 * j + 4, x1));
    for (int j = 0; j < H2 / 4; ++j) {
        vec4 sum = weight(AT_SECOND + j);
        for (int i = 0; i < H1 / 4; ++i) sum += take(AT_SECOND + H2 / 4 + H1 * j + 4 * i, h[i]);
        h2[j] = leaky(sum);
    }
    for (int j = 0; j < H3 / 4; ++j) {
        vec4 sum = weight(AT_THIRD + j);
        for (int i = 0; i < H2 / 4; ++i) sum += take(AT_THIRD + H3 / 4 + H2 * j + 4 * i, h2[i]);
        h3[j] = leaky(sum);
    }
    vec4 last = weight(AT_OUT); // residual rgb of h3, share of hs: one bias, then two blocks
    for (int i = 0; i < H3 / 4; ++i) last += take(AT_OUT + 1 + 4 * i, h3[i]);
#if HAS_SHARE
    vec4 hs[HS / 4];
    for (int j = 0; j < HS / 4; ++j) {
        vec4 sum = weight(AT_SHARE + j);
        for (int i = 0; i < H3 / 4; ++i) sum += take(AT_SHARE + HS / 4 + H3 * j + 4 * i, h3[i]);
        hs[j] = leaky(sum);
    }
    for (int i = 0; i < HS / 4; ++i) last += take(AT_OUT + 1 + H3 + 4 * i, hs[i]);
#endif
    return logistic(last) * vec4(1.0, 1.0, 1.0, 2.0);
}
