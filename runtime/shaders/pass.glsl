// Which splat a fragment of a pass stands for. Passes over a texture of slots: slot and splat. Float division: fragment centres are too far
// from a border to round over it.
int passSlot() { return int(gl_FragCoord.y / float(uRows)); }
ivec2 passSplat() { return ivec2(int(gl_FragCoord.x), int(gl_FragCoord.y) - uRows * passSlot()); }

// Passes over the rows of an instance in a draw list, which begin at uListRow: uCount or more are no splat.
uniform int uListRow;
int listSplat() { return int(gl_FragCoord.x) + uListWidth * (int(gl_FragCoord.y) - uListRow); }
