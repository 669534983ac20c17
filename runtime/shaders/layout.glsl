// Where splat data lives. Splat g of an asset is texel (g % uWidth, g / uWidth) of a grid of uRows rows; slot k of a texture is that grid
// moved down by k * uRows. The coefficients of s and the visibility maps each lie in one long row, all of a splat together, wrapped every
// 2^uRowShift texels and again after as many rows. Lights go `lanes` to a slot, each to a layer of its own.
// A draw list has the splats of all instances of a view, each instance from the start of a row of uListWidth texels on.
// formats/splats/blend.h gives MIN_ALPHA and MAX_ALPHA.
uniform int uCount, uWidth, uRows, uRowShift;
uniform int uListWidth;
ivec2 gridTexel(int g) { return ivec2(g % uWidth, g / uWidth); }
ivec2 slotTexel(ivec2 splat, int slot) { return ivec2(splat.x, splat.y + slot * uRows); }
ivec3 litTexel(ivec2 splat, int light, int lanes) { return ivec3(slotTexel(splat, light / lanes), light % lanes); }
int splatIndex(ivec2 splat) { return splat.x + uWidth * splat.y; }
ivec2 listTexel(int n) { return ivec2(n % uListWidth, n / uListWidth); }

ivec3 longRowTexel(int texel)
{
    int row = texel >> uRowShift, mask = (1 << uRowShift) - 1;
    return ivec3(texel & mask, row & mask, row >> uRowShift);
}
