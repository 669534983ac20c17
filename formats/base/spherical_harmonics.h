// Real, orthonormal spherical harmonics up to degree 4, Condon-Shortley sign, ordered (l, m = -l..l): the basis and
// sign of 3DGS .ply files and of KHR_gaussian_splatting. Function i of degree l has index l*l + l + m.
#pragma once

#include "base/host_device.h"

namespace nacre {

constexpr int kMaxShFunctions = 25; // (degree 4 + 1)^2

/// Writes y[0..count) for the unit direction (x, y, z). `count` is 1, 4, 9, 16 or 25.
template <class T>
NACRE_HD inline void shBasis(int count, T x, T y, T z, T* out)
{
    out[0] = T(0.28209479177387814);
    if (count <= 1) return;
    out[1] = T(-0.48860251190291992) * y;
    out[2] = T(0.48860251190291992) * z;
    out[3] = T(-0.48860251190291992) * x;
    if (count <= 4) return;
    const T xx = x * x, yy = y * y, zz = z * z, xy = x * y, yz = y * z, xz = x * z;
    out[4] = T(1.0925484305920792) * xy;
    out[5] = T(-1.0925484305920792) * yz;
    out[6] = T(0.31539156525252005) * (T(2) * zz - xx - yy);
    out[7] = T(-1.0925484305920792) * xz;
    out[8] = T(0.54627421529603959) * (xx - yy);
    if (count <= 9) return;
    out[9] = T(-0.59004358992664352) * y * (T(3) * xx - yy);
    out[10] = T(2.8906114426405538) * xy * z;
    out[11] = T(-0.45704579946446577) * y * (T(4) * zz - xx - yy);
    out[12] = T(0.37317633259011546) * z * (T(2) * zz - T(3) * xx - T(3) * yy);
    out[13] = T(-0.45704579946446577) * x * (T(4) * zz - xx - yy);
    out[14] = T(1.4453057213202769) * z * (xx - yy);
    out[15] = T(-0.59004358992664352) * x * (xx - T(3) * yy);
    if (count <= 16) return;
    out[16] = T(2.5033429417967046) * xy * (xx - yy);
    out[17] = T(-1.7701307697799304) * yz * (T(3) * xx - yy);
    out[18] = T(0.94617469575756008) * xy * (T(7) * zz - T(1));
    out[19] = T(-0.66904654355728921) * yz * (T(7) * zz - T(3));
    out[20] = T(0.10578554691520431) * (zz * (T(35) * zz - T(30)) + T(3));
    out[21] = T(-0.66904654355728921) * xz * (T(7) * zz - T(3));
    out[22] = T(0.47308734787878004) * (xx - yy) * (T(7) * zz - T(1));
    out[23] = T(-1.7701307697799304) * xz * (xx - T(3) * yy);
    out[24] = T(0.62583573544917614) * (xx * (xx - T(3) * yy) - yy * (T(3) * xx - yy));
}

} // namespace nacre
