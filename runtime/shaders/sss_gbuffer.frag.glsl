// Layers of the G-buffer, blended like colours (reference: splatAlpha of baker/render/reference_raster.h).
uniform float uLayerMax; // what the layers can hold

flat in float vOpacity;
flat in vec3 vLayer[LAYERS];
in vec2 vLocal;
layout(location = 0) out vec4 outLayer[LAYERS];

void main()
{
    float alpha = min(MAX_ALPHA, vOpacity * exp(-0.5 * dot(vLocal, vLocal)));
    if (alpha < MIN_ALPHA) discard;
    // outputs take constant indices only
#define WRITE(k) outLayer[k] = vec4(clamp(vLayer[k], -uLayerMax, uLayerMax) * alpha, alpha)
    WRITE(0);
#if LAYERS > 1
    WRITE(1);
#endif
#if LAYERS > 2
    WRITE(2);
#endif
#if LAYERS > 3
    WRITE(3);
#endif
#if LAYERS > 4
    WRITE(4);
#endif
#if LAYERS > 5
    WRITE(5);
#endif
#if LAYERS > 6
    WRITE(6);
#endif
#if LAYERS > 7
    WRITE(7);
#endif
}
