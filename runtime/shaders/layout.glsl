// Where splat data lives. Splat g is texel (g % WIDTH, g / WIDTH) of a grid of ROWS rows; slot k of a texture is that grid moved
// down by k * ROWS. The array texture starts a new layer every 2^SLOT_SHIFT slots.
// The asset defines WIDTH (a power of two), ROWS, SLOT_SHIFT and S_FUNCTIONS; formats/splats/blend.h gives MIN_ALPHA and MAX_ALPHA.

ivec2 slotTexel(ivec2 splat, int slot) { return ivec2(splat.x, splat.y + slot * ROWS); }
