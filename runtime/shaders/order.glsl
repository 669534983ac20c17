// What the passes of the order share (gpu_order.cpp). Tile t is the pairs from t * GROUP * EACH on; counts of value d of a digit are texels
// d * uTiles + t of one long row.
layout(local_size_x = GROUP) in;
uniform int uTotal;           // pairs
uniform int uTiles, uFirstTile;
uniform int uShift;           // of the digit

int tileIndex() { return uFirstTile + int(gl_WorkGroupID.x); }
ivec2 countTexel(int n) { return ivec2(n % COUNT_WIDTH, n / COUNT_WIDTH); }
uint digitOf(uint key) { return key >> uint(uShift) & uint(DIGITS - 1); }
void wait()                   // for what the workgroup has written to shared memory
{
    memoryBarrierShared();
    barrier();
}
