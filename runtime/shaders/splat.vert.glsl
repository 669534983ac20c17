// One splat whose colour is known (projection: project.glsl).
uniform sampler2D uColor;

flat out vec4 vColor;         // rgb and compensated opacity

void main()
{
    ivec2 splat;
    vec4 meanOpacity;
    float opacity;
    vColor = vec4(0.0);
    if (projectSplat(splat, meanOpacity, opacity)) vColor = vec4(texelFetch(uColor, splat, 0).rgb, opacity);
}
