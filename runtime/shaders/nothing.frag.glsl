// Zero, for rows of a draw list without a surface.
layout(location = 0) out vec4 outNothing[3];

void main()
{
    outNothing[0] = vec4(0.0);
    outNothing[1] = vec4(0.0);
    outNothing[2] = vec4(0.0);
}
