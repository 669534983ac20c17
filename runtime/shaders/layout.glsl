// Where splat data lives. Splat g is texel (g % WIDTH, g / WIDTH) of a grid of ROWS rows; slot k of a texture is that grid moved
// down by k * ROWS. The coefficients of s and the visibility maps each lie in one long row, all of a splat together, wrapped every
// 2^ROW_SHIFT texels and again after as many rows.
// Lights go `lanes` to a slot, each to a layer of its own.
// The asset defines WIDTH (a power of two), ROWS and ROW_SHIFT; formats/splats/blend.h gives MIN_ALPHA and MAX_ALPHA.
ivec2 slotTexel(ivec2 splat, int slot) { return ivec2(splat.x, splat.y + slot * ROWS); }
ivec3 litTexel(ivec2 splat, int light, int lanes) { return ivec3(slotTexel(splat, light / lanes), light % lanes); }
int splatIndex(ivec2 splat) { return splat.x + WIDTH * splat.y; }

ivec3 longRowTexel(int texel)
{
    int row = texel >> ROW_SHIFT, mask = (1 << ROW_SHIFT) - 1;
    return ivec3(texel & mask, row & mask, row >> ROW_SHIFT);
}
