// One triangle over the whole viewport, with the place in it.
out vec2 vPlace;              // 0 to 1, y upwards in clip space

void main()
{
    vec2 clip = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
    vPlace = 0.5 * clip + 0.5;
    gl_Position = vec4(clip, 0.0, 1.0);
}
