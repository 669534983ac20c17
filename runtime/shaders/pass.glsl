// Slot and splat of the fragment of a relighting pass. Float division: fragment centres are too far from a border to round over it.
int passSlot() { return int(gl_FragCoord.y / float(ROWS)); }
ivec2 passSplat() { return ivec2(gl_FragCoord.x, int(gl_FragCoord.y) - ROWS * passSlot()); }
