// exp2 and log2 on Highway vectors of floats. Included once per SIMD target, hence the toggled guard.
#if defined(NACRE_SIMD_MATH_INL_H) == defined(HWY_TARGET_TOGGLE)
#ifdef NACRE_SIMD_MATH_INL_H
#undef NACRE_SIMD_MATH_INL_H
#else
#define NACRE_SIMD_MATH_INL_H
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace nacre {
namespace HWY_NAMESPACE {

/// 2^x for -126 <= x < 128, relative error 2e-7: degree-6 expansion around the nearest integer.
template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V exp2(D d, V x)
{
    namespace hn = hwy::HWY_NAMESPACE;
    const hn::RebindToSigned<D> di;
    const V n = hn::Round(x), f = hn::Sub(x, n);
    V p = hn::Set(d, 1.5403530e-4f);
    p = hn::MulAdd(p, f, hn::Set(d, 1.3333558e-3f));
    p = hn::MulAdd(p, f, hn::Set(d, 9.6181291e-3f));
    p = hn::MulAdd(p, f, hn::Set(d, 5.5504109e-2f));
    p = hn::MulAdd(p, f, hn::Set(d, 2.4022651e-1f));
    p = hn::MulAdd(p, f, hn::Set(d, 6.9314718e-1f));
    p = hn::MulAdd(p, f, hn::Set(d, 1.0f));
    return hn::Mul(p, hn::BitCast(d, hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, n), hn::Set(di, 127)))));
}

/// log2 of a positive normal number, absolute error 2e-7: atanh series around the nearest power of two.
template <class D, class V = hwy::HWY_NAMESPACE::Vec<D>>
HWY_INLINE V log2(D d, V x)
{
    namespace hn = hwy::HWY_NAMESPACE;
    const hn::RebindToSigned<D> di;
    const auto bits = hn::BitCast(di, x);
    const auto exponent = hn::Sub(hn::ShiftRight<23>(bits), hn::Set(di, 127));
    V mantissa = hn::BitCast(d, hn::Or(hn::And(bits, hn::Set(di, 0x007fffff)), hn::Set(di, 0x3f800000)));
    const auto big = hn::Gt(mantissa, hn::Set(d, 1.41421356f));
    mantissa = hn::IfThenElse(big, hn::Mul(mantissa, hn::Set(d, 0.5f)), mantissa);
    const V e = hn::Add(hn::ConvertTo(d, exponent), hn::IfThenElseZero(big, hn::Set(d, 1.0f)));
    const V s = hn::Div(hn::Sub(mantissa, hn::Set(d, 1.0f)), hn::Add(mantissa, hn::Set(d, 1.0f)));
    const V s2 = hn::Mul(s, s);
    V p = hn::Set(d, 1.0f / 9);
    p = hn::MulAdd(p, s2, hn::Set(d, 1.0f / 7));
    p = hn::MulAdd(p, s2, hn::Set(d, 1.0f / 5));
    p = hn::MulAdd(p, s2, hn::Set(d, 1.0f / 3));
    p = hn::MulAdd(p, s2, hn::Set(d, 1.0f));
    return hn::MulAdd(hn::Mul(p, s), hn::Set(d, 2.88539008f), e);
}

} // namespace HWY_NAMESPACE
} // namespace nacre
HWY_AFTER_NAMESPACE();

#endif
