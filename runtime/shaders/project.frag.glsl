// EWA projection of one Gaussian (reference: baker/render/projection.h): Sigma' = J W Sigma W^T J^T + lowPass * I in pixels^2,
// opacity times sqrt(det raw / det filtered). A fragment per splat of an instance writes the record of the draw list:
//   0: ndc x, y, depth, opacity (0: not drawn)      1: L with Sigma' = L L^T as l_xx, l_yx, l_yy; distance from the eye in the world
uniform sampler2D uGeometry;  // slot 0: mean, opacity; 1: quaternion xyzw; 2: scales
uniform mat3 uViewFromAsset;  // rotation times uniform scale
uniform vec3 uViewTranslation;
uniform mat3 uWorldFromAsset;
uniform vec3 uFromEye;
uniform vec4 uTowardsEye;     // orthographic: direction and 1
uniform mat4 uClipFromView;
uniform vec2 uViewport;       // pixels
uniform float uJacobianLimit; // J is evaluated at ndc clamped to +- this
uniform float uNear;          // clip w
uniform vec4 uNearPlane;      // positive beyond it; GL clips there as well, but not under depth clamp
uniform float uLowPass;       // pixels^2
uniform int uLit;             // 0: of an instance that was never lit, nothing is drawn
uniform int uCompensate;      // 0: opacity as it is, for splats that are drawn whole or not at all

layout(location = 0) out vec4 outProjected0;
layout(location = 1) out vec4 outProjected1;

void main()
{
    int g = listSplat();
    if (g >= uCount) discard;
    outProjected0 = outProjected1 = vec4(0.0);
    ivec2 splat = gridTexel(g);
    vec4 meanOpacity = texelFetch(uGeometry, splat, 0);
    vec3 p = uViewFromAsset * meanOpacity.xyz + uViewTranslation;
    vec4 clip = uClipFromView * vec4(p, 1.0);
    if (uLit == 0 || !(clip.w > uNear && dot(uNearPlane, vec4(p, 1.0)) > 0.0)) return;
    vec2 ndc = clip.xy / clip.w;

    // Rows of J: derivative of the pixel position by the view position, at a clamped direction (off-screen splats stay tame).
    vec2 at = clamp(ndc, vec2(-uJacobianLimit), vec2(uJacobianLimit));
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
    float opacity = meanOpacity.w * (uCompensate != 0 ? sqrt(detRaw / det) : 1.0);
    if (!(opacity >= MIN_ALPHA)) return; // also drops NaN

    float lxx = sqrt(xx + uLowPass);
    vec3 fromEye = uWorldFromAsset * meanOpacity.xyz + uFromEye;
    float distance = uTowardsEye.w > 0.0 ? -dot(uTowardsEye.xyz, fromEye) : length(fromEye);
    outProjected0 = vec4(ndc, clip.z / clip.w, opacity);
    outProjected1 = vec4(lxx, xy / lxx, sqrt(det) / lxx, distance);
}
