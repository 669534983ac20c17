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
#define WRITE(k) outLayer[k] = vec4(clamp(vLayer[k], -uLayerMax, uLayerMax) * alpha, alpha)
    EACH_LAYER(WRITE);
}
