// What the passes of the tile rasteriser share (tile_raster.cpp). Ranks count from the nearest splat on; a batch is uRanks of them from
// uFirstRank on. Pixels are those of the viewport, y upwards in clip space.
uniform sampler2D uProjected0, uProjected1;
uniform usampler2D uOrder;    // indices in the list, far to near
uniform vec2 uViewport;
uniform vec2 uDepthRange;     // GL clips quads outside
uniform int uSplats, uFirstRank, uRanks;
uniform int uBinsX, uBinsY;

struct Footprint {
    vec2 centre, halfSize;    // of the box that holds alpha >= MIN_ALPHA
    vec3 l;                   // see project.frag.glsl
    float opacity, depth;     // clip z / w
};

ivec2 rankedTexel(int rank) { return listTexel(int(texelFetch(uOrder, listTexel(uSplats - 1 - rank), 0).r)); }

bool fetchFootprint(ivec2 texel, out Footprint f)
{
    vec4 p = texelFetch(uProjected0, texel, 0);
    if (!(p.w > 0.0 && p.z >= uDepthRange.x && p.z <= uDepthRange.y)) return false;
    f.l = texelFetch(uProjected1, texel, 0).xyz;
    f.opacity = p.w, f.depth = p.z;
    f.centre = (0.5 * p.xy + 0.5) * uViewport;
    f.halfSize = (sqrt(max(2.0 * log(p.w / MIN_ALPHA), 0.0)) + 1e-3) * vec2(f.l.x, length(f.l.yz));
    return true;
}
