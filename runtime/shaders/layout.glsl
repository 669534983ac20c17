// Where splat data lives. Splat g is texel (g % WIDTH, g / WIDTH) of a grid of ROWS rows; slot k of a texture is that grid moved
// down by k * ROWS. The coefficients of s lie in one long row, wrapped every 2^SCATTER_SHIFT texels and again after as many rows.
// The asset defines WIDTH (a power of two), ROWS, SCATTER_SHIFT, S_FUNCTIONS; formats/splats/blend.h gives MIN_ALPHA and MAX_ALPHA.
ivec2 slotTexel(ivec2 splat, int slot) { return ivec2(splat.x, splat.y + slot * ROWS); }

// a_i of a splat: its grid row becomes S_FUNCTIONS rows, so that fragments that read the same coefficients are neighbours.
ivec2 contractedTexel(ivec2 splat, int i) { return ivec2(splat.x, splat.y * S_FUNCTIONS + i); }
