// EWA projection of one Gaussian (reference: baker/render/projection.h): Sigma' = J W Sigma W^T J^T + lowPass * I in pixels^2,
// opacity times sqrt(det raw / det filtered). Four vertices per splat make the parallelogram L*u, |u_x|, |u_y| <= r, where
// Sigma' = L L^T and r is where alpha falls to 1/255, so the fragment's exponent is just |u|^2 / 2.
uniform sampler2D uGeometry;  // slot 0: mean, opacity; 1: quaternion xyzw; 2: scales
uniform usampler2D uOrder;    // splat index of the n-th splat, far to near
uniform mat3 uViewFromAsset;  // rotation times uniform scale
uniform vec3 uViewTranslation;
uniform mat4 uClipFromView;
uniform vec2 uViewport;       // pixels
uniform float uJacobianLimit; // J is evaluated at ndc clamped to +- this
uniform float uNear;          // clip w
uniform vec4 uNearPlane;      // positive beyond it; GL clips there as well, but not under depth clamp
uniform float uLowPass;       // pixels^2

out vec2 vLocal;              // u

// Writes gl_Position and vLocal. False: the vertex lies outside the clip volume and the splat is not drawn.
bool projectSplat(out ivec2 splat, out vec4 meanOpacity, out float opacity)
{
    gl_Position = vec4(0.0, 0.0, 2.0, 1.0); // outside until the splat has proved visible
    vLocal = vec2(0.0);
    opacity = 0.0;

    int rank = gl_VertexID >> 2;
    int g = int(texelFetch(uOrder, ivec2(rank % WIDTH, rank / WIDTH), 0).r);
    splat = ivec2(g % WIDTH, g / WIDTH);
    meanOpacity = texelFetch(uGeometry, splat, 0);
    vec3 p = uViewFromAsset * meanOpacity.xyz + uViewTranslation;
    vec4 clip = uClipFromView * vec4(p, 1.0);
    if (!(clip.w > uNear && dot(uNearPlane, vec4(p, 1.0)) > 0.0)) return false;
    vec2 ndc = clip.xy / clip.w;

    // Rows of J: derivative of the pixel position by the view position, at a clamped direction (off-screen splats stay tame).
    vec2 at = clamp(ndc, -uJacobianLimit, uJacobianLimit);
    mat4 rows = transpose(uClipFromView);
    vec3 jx = (rows[0].xyz - at.x * rows[3].xyz) * (0.5 * uViewport.x / clip.w);
    vec3 jy = (rows[1].xyz - at.y * rows[3].xyz) * (0.5 * uViewport.y / clip.w);

    // Rows of M = J W R S; Sigma' raw = M M^T and its determinant |mx cross my|^2 stays accurate for needles.
    vec4 q = texelFetch(uGeometry, slotTexel(splat, 1), 0);
    vec3 s = texelFetch(uGeometry, slotTexel(splat, 2), 0).xyz;
    mat3 r = mat3(1.0 - 2.0 * (q.y * q.y + q.z * q.z), 2.0 * (q.x * q.y + q.w * q.z), 2.0 * (q.x * q.z - q.w * q.y),
                  2.0 * (q.x * q.y - q.w * q.z), 1.0 - 2.0 * (q.x * q.x + q.z * q.z), 2.0 * (q.y * q.z + q.w * q.x),
                  2.0 * (q.x * q.z + q.w * q.y), 2.0 * (q.y * q.z - q.w * q.x), 1.0 - 2.0 * (q.x * q.x + q.y * q.y));
    vec3 mx = s * ((jx * uViewFromAsset) * r);
    vec3 my = s * ((jy * uViewFromAsset) * r);
    vec3 c = cross(mx, my);
    float xx = dot(mx, mx), xy = dot(mx, my), yy = dot(my, my);
    float detRaw = dot(c, c);
    float det = detRaw + uLowPass * (xx + yy + uLowPass);
    opacity = meanOpacity.w * sqrt(detRaw / det);
    if (!(opacity >= MIN_ALPHA)) return false; // also drops NaN

    float lxx = sqrt(xx + uLowPass);
    float lyx = xy / lxx;
    float lyy = sqrt(det) / lxx;
    float extent = sqrt(max(2.0 * log(opacity / MIN_ALPHA), 0.0)) + 1e-3; // the fragment decides exactly
    vLocal = extent * (2.0 * vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) - 1.0);
    vec2 offset = vec2(lxx * vLocal.x, lyx * vLocal.x + lyy * vLocal.y);
    gl_Position = vec4(ndc + 2.0 * offset / uViewport, clip.z / clip.w, 1.0); // the quad lies at the centre's depth
    return true;
}
