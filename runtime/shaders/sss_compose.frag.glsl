// The light of all passes, summed where it cannot overflow, into the host's frame.
uniform sampler2DArray uSum;
uniform float uMaxColor;

layout(location = 0) out vec4 outColor;

void main()
{
    vec4 sum = texelFetch(uSum, ivec3(gl_FragCoord.xy, 0), 0);
    if (sum.a <= 0.0) discard;
    outColor = vec4(min(sum.rgb, uMaxColor * sum.a), sum.a);
}
