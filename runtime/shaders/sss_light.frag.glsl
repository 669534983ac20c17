// The light pass of sss in GL 3.3: a fragment per (splat, LANES lights).
layout(location = 0) out vec4 outLit[LANES];

void main() { lightSplat(passSplat(), passSlot(), outLit); }
