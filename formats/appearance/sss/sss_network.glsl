// GLSL twin of sssNetworkLight (appearance/sss/sss_network.h), for LANES lights at once: a weight is fetched once for all of them. Features go
// four to a vec4; weight texel (first + rows * j + i) holds what four outputs 4j..4j+3 take from input i (packNetwork in
// runtime/src/sss_gpu.cpp), and a row of biases comes before them.
// H1 to HS: sizes of the layers; AT_*: where each layer begins. Without HAS_SHARE (its weights are all 0) the share is 1.
// COMPUTE: a workgroup of GROUP invocations reads the weights from shared memory, which fetchWeights fills.
uniform sampler2D uWeights;
uniform sampler2D uFirst; // slot j: outputs 4j..4j+3 of the first layer before light and view
uniform int uOneLoop; // Always 1. Loop counts are multiplied by it so that compilers cannot unroll: unrolled, software rasterisers compile for minutes.

vec4 weightTexel(int texel) { return texelFetch(uWeights, ivec2(texel & 1023, texel >> 10), 0); }
#if COMPUTE
shared vec4 sWeights[AT_END];
vec4 weight(int texel) { return sWeights[texel]; }
void fetchWeights()
{
    for (int i = int(gl_LocalInvocationIndex); i < AT_END; i += GROUP) sWeights[i] = weightTexel(i);
    barrier();
}
#else
vec4 weight(int texel) { return weightTexel(texel); }
#endif
mat4 block(int at) { return mat4(weight(at), weight(at + 1), weight(at + 2), weight(at + 3)); } // of four inputs and four outputs
vec4 leaky(vec4 x) { return max(x, LEAK * x); }
vec4 logistic(vec4 x) { return 1.0 / (1.0 + exp(-clamp(x, -80.0, 80.0))); }

// x0, x1: the eight inputs that depend on light and view. answer: residual rgb, share. A layer's outputs go into the sums of the next one as
// soon as they are known.
void sssNetwork(ivec2 splat, vec4 x0[LANES], vec4 x1[LANES], out vec4 answer[LANES])
{
    vec4 h2[LANES * H2 / 4], hs[LANES * HS / 4];
    for (int j = 0; j < H2 / 4; ++j)
        for (int l = 0; l < LANES; ++l) h2[LANES * j + l] = weight(AT_SECOND + j);
    for (int i = 0; i < H1 / 4 * uOneLoop; ++i) {
        vec4 before = texelFetch(uFirst, slotTexel(splat, i), 0), h1[LANES];
        mat4 a = block(AT_LIGHT + 8 * i), b = block(AT_LIGHT + 8 * i + 4);
        for (int l = 0; l < LANES; ++l) h1[l] = leaky(before + a * x0[l] + b * x1[l]);
        for (int j = 0; j < H2 / 4; ++j) {
            mat4 w = block(AT_SECOND + H2 / 4 + H1 * j + 4 * i);
            for (int l = 0; l < LANES; ++l) h2[LANES * j + l] += w * h1[l];
        }
    }
    for (int k = 0; k < LANES * H2 / 4; ++k) h2[k] = leaky(h2[k]);

    for (int l = 0; l < LANES; ++l) answer[l] = weight(AT_OUT); // residual rgb of h3, share of hs: one bias, then two blocks
#if HAS_SHARE
    for (int j = 0; j < HS / 4; ++j)
        for (int l = 0; l < LANES; ++l) hs[LANES * j + l] = weight(AT_SHARE + j);
#endif
    for (int i = 0; i < H3 / 4 * uOneLoop; ++i) {
        vec4 h3[LANES];
        for (int l = 0; l < LANES; ++l) h3[l] = weight(AT_THIRD + i);
        for (int k = 0; k < H2 / 4; ++k) {
            mat4 w = block(AT_THIRD + H3 / 4 + H2 * i + 4 * k);
            for (int l = 0; l < LANES; ++l) h3[l] += w * h2[LANES * k + l];
        }
        mat4 residual = block(AT_OUT + 1 + 4 * i);
        for (int l = 0; l < LANES; ++l) h3[l] = leaky(h3[l]), answer[l] += residual * h3[l];
#if HAS_SHARE
        for (int j = 0; j < HS / 4; ++j) {
            mat4 w = block(AT_SHARE + HS / 4 + H3 * j + 4 * i);
            for (int l = 0; l < LANES; ++l) hs[LANES * j + l] += w * h3[l];
        }
#endif
    }
#if HAS_SHARE
    for (int j = 0; j < HS / 4; ++j) {
        mat4 w = block(AT_OUT + 1 + H3 + 4 * j);
        for (int l = 0; l < LANES; ++l) answer[l] += w * leaky(hs[LANES * j + l]);
    }
#endif
    for (int l = 0; l < LANES; ++l) answer[l] = logistic(answer[l]) * vec4(1.0, 1.0, 1.0, 2.0);
}
