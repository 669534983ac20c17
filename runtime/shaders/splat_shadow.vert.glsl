// One splat that holds up light: at which planes, and how much.
uniform float uFirstPlane, uPlaneStep; // distances from the light

flat out float vOpacity;
flat out vec4 vBehind; // 1 for planes behind it

void main()
{
    ivec2 texel;
    float distance;
    vOpacity = 0.0, vBehind = vec4(0.0);
    if (!placeSplat(texel, vOpacity, distance)) return;
    gl_Position.z = 0.5; // whatever glClipControl says, nothing is clipped at its depth
    vBehind = vec4(lessThan(vec4(distance), uFirstPlane + uPlaneStep * vec4(0.0, 1.0, 2.0, 3.0)));
}
