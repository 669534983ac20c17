// A splat of the draw list as a quad: four vertices per splat make the parallelogram L*u, |u_x|, |u_y| <= r, where r is where alpha falls to
// 1/255, so the fragment's exponent is just |u|^2 / 2. The record: project.frag.glsl.
uniform sampler2D uProjected0, uProjected1;
#ifdef UNORDERED
uniform int uFirstIndex;      // in the list, of the first splat
#else
uniform usampler2D uOrder;    // index in the list of the n-th splat, far to near
#endif
uniform vec2 uViewport;       // pixels

out vec2 vLocal;              // u

const float FARTHEST_REACH = 8.0; // of a quad from its middle, in widths or heights of the frame

// Writes gl_Position and vLocal. False: the splat is not drawn.
bool placeSplat(out ivec2 texel, out float opacity, out float distance)
{
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside until the splat has proved visible
    vLocal = vec2(0.0);
#ifdef UNORDERED
    texel = listTexel(uFirstIndex + (gl_VertexID >> 2));
#else
    texel = listTexel(int(texelFetch(uOrder, listTexel(gl_VertexID >> 2), 0).r));
#endif
    vec4 p = texelFetch(uProjected0, texel, 0);
    opacity = p.w, distance = 0.0;
    if (!(opacity > 0.0)) return false;
    vec4 l = texelFetch(uProjected1, texel, 0);
    distance = l.w;
    float extent = sqrt(max(2.0 * log(opacity / MIN_ALPHA), 0.0)) + 1e-3; // the fragment decides exactly
    vec2 corner = 2.0 * vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) - 1.0;
    vLocal = extent * corner;
    vec2 offset = vec2(l.x * vLocal.x, l.y * vLocal.x + l.z * vLocal.y);
    gl_Position = vec4(p.xy + 2.0 * offset / uViewport, p.z, 1.0); // the quad lies at the centre's depth
    vec2 reach = extent * vec2(l.x, abs(l.y) + l.z) / uViewport;
    if (max(reach.x, reach.y) > FARTHEST_REACH) { // GL rounds what lies between corners so far away: those of the frame instead
        offset = 0.5 * uViewport * (corner - p.xy);
        vLocal = vec2(offset.x / l.x, (offset.y - l.y / l.x * offset.x) / l.z);
        gl_Position.xy = corner;
    }
    return true;
}
