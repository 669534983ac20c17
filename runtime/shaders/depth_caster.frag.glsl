// A splat is opaque where its alpha suffices.
uniform float uLeastAlpha;

flat in vec2 vDepthOpacity;
in vec2 vLocal;

void main()
{
    if (!(vDepthOpacity.y * exp(-0.5 * dot(vLocal, vLocal)) >= uLeastAlpha)) discard;
}
