// Incident shares of the view's lights, three to a layer, into the rows of an instance in the draw list. The lights of the view come from
// slots of the instance's batch, or from none (-1).
uniform sampler2DArray uLit;  // see litTexel; alpha is the incident share
uniform int uLanes;
uniform int uSlots[3 * LAYERS];

layout(location = 0) out vec4 outShares[LAYERS];

void main()
{
    int g = listSplat();
    if (g >= uCount) discard;
    ivec2 splat = gridTexel(g);
    float shares[3 * LAYERS];
    for (int i = 0; i < 3 * LAYERS; ++i) shares[i] = uSlots[i] < 0 ? 0.0 : texelFetch(uLit, litTexel(splat, uSlots[i], uLanes), 0).a;
#define WRITE(k) outShares[k] = vec4(shares[3 * k], shares[3 * k + 1], shares[3 * k + 2], 0.0)
    EACH_LAYER(WRITE);
}
