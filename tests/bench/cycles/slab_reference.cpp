// Reflectance of a homogeneous half space, the reference for the random walk of the light stage. It shares no code with the tracer.
// Two methods that have nothing in common but the physics, so that agreement means something:
//
// Monte Carlo. Photons walk in units of the mean free path (sigma_t = 1, z > 0 inside) and are never absorbed: the number n of
//   scatterings before the exit gives R(alpha) = E[alpha^n] for every alpha from one walk. A walk is cut at n = 30000
//   (0.999^30000 = 1e-13). The mean exit distance of index-matched walks, E[alpha^n r] / E[alpha^n], fixes the length scale.
// Adding-doubling (de Haan, Bosma & Hovenier 1987). The azimuthal mean of radiance suffices for reflectance. With quadrature nodes mu_i
//   and weights w_i on (0, 1], R_ij maps downward to upward radiance. A thin layer (diamond scheme: the transport equation at the
//   layer's middle) is doubled until it is 2^k * dtau thick. The boundary then adds its internal reflection F: with d down, u up,
//   d = d0 + F u, u = R d. Nodes are split at the critical angle, where F has a kink.
// For g = 0 and an index-matched boundary both are checked against Chandrasekhar's H function (Radiative Transfer, 1960):
//   1/H(mu) = sqrt(1 - alpha) + alpha/2 Int mu' H(mu') / (mu + mu') dmu',  R(mu0) = 1 - sqrt(1 - alpha) H(mu0),
//   R(cosine) = 1 - 2 sqrt(1 - alpha) Int H(mu) mu dmu.
//
//   g++ -O2 -std=c++20 -pthread slab_reference.cpp -o slab_reference && ./slab_reference [photons per case] > slab_reference.md
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <numbers>
#include <thread>
#include <utility>
#include <vector>

namespace {

constexpr std::array kAlphas = {0.5, 0.9, 0.99, 0.999};
constexpr int kCut = 30000;

// Reflectance of a smooth dielectric seen under `cosI` from a medium; eta = index beyond / index on this side.
double fresnel(double cosI, double eta)
{
    double sin2T = (1 - cosI * cosI) / (eta * eta);
    if (sin2T >= 1) return 1;
    double cosT = std::sqrt(1 - sin2T);
    double s = (cosI - eta * cosT) / (cosI + eta * cosT), p = (eta * cosI - cosT) / (eta * cosI + cosT);
    return (s * s + p * p) / 2;
}

// ---- quadrature -------------------------------------------------------------------------------------------------------------------

struct Nodes {
    std::vector<double> x, w;
};

// Gauss-Legendre on [a, b], appended.
void appendGauss(Nodes& nodes, int n, double a, double b)
{
    for (int i = 0; i < n; ++i) {
        double x = std::cos(std::numbers::pi * (i + 0.75) / (n + 0.5)), slope = 1;
        for (int step = 0; step < 60; ++step) {
            double p0 = 1, p1 = x;
            for (int k = 2; k <= n; ++k) p0 = std::exchange(p1, ((2 * k - 1) * x * p1 - (k - 1) * p0) / k);
            slope = n * (x * p1 - p0) / (x * x - 1);
            double dx = p1 / slope;
            x -= dx;
            if (std::abs(dx) < 1e-15) break;
        }
        nodes.x.push_back((a + b) / 2 - (b - a) / 2 * x);
        nodes.w.push_back((b - a) / ((1 - x * x) * slope * slope));
    }
}

// ---- H function -------------------------------------------------------------------------------------------------------------------

struct HValues {
    double cosine, normal; // reflectance under cosine-distributed and under normal incidence
};

HValues chandrasekhar(double alpha)
{
    Nodes q;
    appendGauss(q, 40, 0, 0.05);
    appendGauss(q, 60, 0.05, 1);
    std::vector<double> h(q.x.size(), 1.0);
    double root = std::sqrt(1 - alpha);
    auto next = [&](double mu) {
        double sum = 0;
        for (size_t j = 0; j < q.x.size(); ++j) sum += q.w[j] * q.x[j] * h[j] / (mu + q.x[j]);
        return 1 / (root + alpha / 2 * sum);
    };
    for (int step = 0; step < 3000; ++step) { // averaging steps: the plain iteration oscillates
        std::vector<double> fresh(h.size());
        for (size_t i = 0; i < h.size(); ++i) fresh[i] = (h[i] + next(q.x[i])) / 2;
        h = fresh;
    }
    double moment = 0;
    for (size_t i = 0; i < h.size(); ++i) moment += q.w[i] * h[i] * q.x[i];
    return {1 - 2 * root * moment, 1 - root * next(1.0)};
}

// ---- adding-doubling --------------------------------------------------------------------------------------------------------------

using Matrix = std::vector<double>; // n x n, row-major

Matrix multiply(const Matrix& a, const Matrix& b, size_t n)
{
    Matrix c(n * n, 0.0);
    for (size_t i = 0; i < n; ++i)
        for (size_t k = 0; k < n; ++k)
            for (size_t j = 0; j < n; ++j) c[i * n + j] += a[i * n + k] * b[k * n + j];
    return c;
}

// Solves a x = b for all columns of b (n x m) by elimination with row exchange.
Matrix solve(Matrix a, Matrix b, size_t n, size_t m)
{
    for (size_t k = 0; k < n; ++k) {
        size_t pivot = k;
        for (size_t i = k + 1; i < n; ++i)
            if (std::abs(a[i * n + k]) > std::abs(a[pivot * n + k])) pivot = i;
        for (size_t j = 0; j < n; ++j) std::swap(a[k * n + j], a[pivot * n + j]);
        for (size_t j = 0; j < m; ++j) std::swap(b[k * m + j], b[pivot * m + j]);
        for (size_t i = 0; i < n; ++i) {
            if (i == k) continue;
            double f = a[i * n + k] / a[k * n + k];
            if (f == 0) continue;
            for (size_t j = k; j < n; ++j) a[i * n + j] -= f * a[k * n + j];
            for (size_t j = 0; j < m; ++j) b[i * m + j] -= f * b[k * m + j];
        }
    }
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < m; ++j) b[i * m + j] /= a[i * n + i];
    return b;
}

struct Reflectance {
    double cosine, normal;                       // index-matched
    double dielectricCosine, dielectricNormal;   // all light that comes back, with the mirror reflection
    double mirrorCosine, mirrorNormal;           // of which mirror reflection
};

Reflectance addingDoubling(double alpha, double g, double ior)
{
    double critical = std::sqrt(1 - 1 / (ior * ior));
    Nodes q;
    appendGauss(q, 24, 0, critical);
    appendGauss(q, 24, critical, 1);
    q.x.push_back(1.0); // normal incidence: a node of weight 0 carries no energy and only reads the solution
    q.w.push_back(0.0);
    size_t n = q.x.size();

    // Azimuthal mean of Henyey-Greenstein, normalised to 1 over mu in [-1, 1] with factor 1/2: sum (2l+1) g^l P_l(mu) P_l(mu').
    auto phase = [&](double a, double b) {
        double sum = 0, gl = 1, a0 = 1, a1 = a, b0 = 1, b1 = b;
        for (int l = 0; l < 60; ++l) { // 0.5^60: below double precision
            sum += (2 * l + 1) * gl * a0 * b0;
            a0 = std::exchange(a1, ((2 * l + 3) * a * a1 - (l + 1) * a0) / (l + 2));
            b0 = std::exchange(b1, ((2 * l + 3) * b * b1 - (l + 1) * b0) / (l + 2));
            gl *= g;
        }
        return sum;
    };
    // Thin layer. mu du/dtau = -u + S, S = alpha/2 sum_j w_j (p(+) same side + p(-) other side); middle radiance = mean of the borders:
    // (I + A) out = (I - A) in + B (in' + out'), A = dtau/2 M^-1 (I - alpha/2 p+ W), B = dtau/2 M^-1 alpha/2 p- W, ' = the other side.
    double dtau = 1.0 / (1 << 16);
    Matrix minus(n * n), plus(n * n), back(n * n);
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j) {
            double half = dtau / 2 / q.x[i];
            double a = half * ((i == j) - alpha / 2 * phase(q.x[i], q.x[j]) * q.w[j]);
            minus[i * n + j] = (i == j) - a;
            plus[i * n + j] = (i == j) + a;
            back[i * n + j] = half * alpha / 2 * phase(q.x[i], -q.x[j]) * q.w[j];
        }
    // Sum and difference of the two sides decouple: out + R-side: (plus - back)(T + R) = minus + back, (plus + back)(T - R) = minus - back.
    Matrix lhs1(n * n), rhs1(n * n), lhs2(n * n), rhs2(n * n);
    for (size_t k = 0; k < n * n; ++k) {
        lhs1[k] = plus[k] - back[k];
        rhs1[k] = minus[k] + back[k];
        lhs2[k] = plus[k] + back[k];
        rhs2[k] = minus[k] - back[k];
    }
    Matrix sum = solve(lhs1, rhs1, n, n), difference = solve(lhs2, rhs2, n, n), r(n * n), t(n * n);
    for (size_t k = 0; k < n * n; ++k) {
        r[k] = (sum[k] - difference[k]) / 2;
        t[k] = (sum[k] + difference[k]) / 2;
    }
    for (int doubling = 0; doubling < 28; ++doubling) { // 4096 mean free paths; alpha = 0.999 decays as exp(-0.055 tau)
        Matrix rr = multiply(r, r, n), left(n * n);
        for (size_t i = 0; i < n; ++i)
            for (size_t j = 0; j < n; ++j) left[i * n + j] = (i == j) - rr[i * n + j];
        Matrix mid = solve(left, t, n, n); // (1 - R R)^-1 T: downward radiance between the halves
        Matrix trm = multiply(t, multiply(r, mid, n), n);
        t = multiply(t, mid, n);
        for (size_t k = 0; k < n * n; ++k) r[k] += trm[k];
    }

    auto flux = [&](const Matrix& column) { // 2 sum w mu I: irradiance / pi
        double f = 0;
        for (size_t i = 0; i < n; ++i) f += 2 * q.w[i] * q.x[i] * column[i];
        return f;
    };
    // Reflectance at normal incidence from reciprocity: the radiance at mu = 1 under uniform light from above, R(1, uniform).
    Reflectance out{};
    Matrix ones(n, 1.0), up = multiply(r, Matrix(n * n, 1.0), n), column(n);
    for (size_t i = 0; i < n; ++i) column[i] = up[i * n];
    out.cosine = flux(column);
    out.normal = column[n - 1];

    // Dielectric: uniform radiance 1 outside is n^2 (1 - F(mu)) inside for mu above the critical angle, nothing below. The upward
    // radiance u leaves as u (1 - F) / n^2. Solve (1 - R F) u = R d0.
    Matrix left(n * n), d0(n), rhs(n, 0.0);
    for (size_t j = 0; j < n; ++j) d0[j] = ior * ior * (1 - fresnel(q.x[j], 1 / ior));
    for (size_t i = 0; i < n; ++i)
        for (size_t j = 0; j < n; ++j) {
            left[i * n + j] = (i == j) - r[i * n + j] * fresnel(q.x[j], 1 / ior);
            rhs[i] += r[i * n + j] * d0[j];
        }
    Matrix u = solve(left, rhs, n, 1);
    double diffuse = 0;
    for (size_t i = 0; i < n; ++i) diffuse += 2 * q.w[i] * q.x[i] * (1 - fresnel(q.x[i], 1 / ior)) * u[i]; // dmu^2 n^2 outside cancels 1/n^2
    Nodes outside;
    appendGauss(outside, 200, 0, 1);
    for (size_t i = 0; i < outside.x.size(); ++i) out.mirrorCosine += 2 * outside.w[i] * outside.x[i] * fresnel(outside.x[i], ior);
    out.mirrorNormal = fresnel(1, ior);
    out.dielectricCosine = out.mirrorCosine + diffuse;
    out.dielectricNormal = out.mirrorNormal + (1 - fresnel(1, 1 / ior)) * u[n - 1] / (ior * ior); // reciprocity again
    return out;
}

// ---- Monte Carlo ------------------------------------------------------------------------------------------------------------------

struct Random { // xoshiro256+ (Blackman and Vigna 2018), seeded by splitmix64
    uint64_t s[4];
    explicit Random(uint64_t seed)
    {
        for (uint64_t& v : s) {
            seed += 0x9e3779b97f4a7c15u;
            uint64_t z = seed;
            z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
            z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
            v = z ^ (z >> 31);
        }
    }
    double operator()() // [0, 1)
    {
        uint64_t result = s[0] + s[3], t = s[1] << 17;
        s[2] ^= s[0];
        s[3] ^= s[1];
        s[1] ^= s[2];
        s[0] ^= s[3];
        s[2] ^= t;
        s[3] = (s[3] << 45) | (s[3] >> 19);
        return static_cast<double>(result >> 11) * 0x1p-53;
    }
};

enum class Entry { kCosine, kNormal };

struct Tally { // per alpha: sums of w = alpha^n, w^2 and w * exit distance
    double n = 0, w[kAlphas.size()] = {}, w2[kAlphas.size()] = {}, wr[kAlphas.size()] = {};
    void add(int scatterings, double r)
    {
        n += 1;
        for (size_t i = 0; i < kAlphas.size(); ++i) {
            double weight = std::pow(kAlphas[i], scatterings);
            w[i] += weight;
            w2[i] += weight * weight;
            wr[i] += weight * r;
        }
    }
};

void walk(Tally& tally, Random& rnd, Entry entry, double g, double ior)
{
    double cosine = entry == Entry::kCosine ? std::sqrt(1 - rnd()) : 1.0;
    if (ior != 1) {
        if (rnd() < fresnel(cosine, ior)) return tally.add(0, 0); // mirror
        cosine = std::sqrt(1 - (1 - cosine * cosine) / (ior * ior));
    }
    double dx = std::sqrt(1 - cosine * cosine), dy = 0, dz = cosine, x = 0, y = 0, z = 0;
    for (int scatterings = 0; scatterings < kCut;) {
        double step = -std::log(1 - rnd());
        if (z + step * dz < 0) { // reaches the surface
            double toSurface = z / -dz;
            x += toSurface * dx;
            y += toSurface * dy;
            z = 0;
            if (ior == 1 || rnd() >= fresnel(-dz, 1 / ior)) return tally.add(scatterings, std::hypot(x, y));
            dz = -dz;
            continue; // exponential steps have no memory
        }
        x += step * dx;
        y += step * dy;
        z += step * dz;
        ++scatterings;
        double u = rnd(), c = 1 - 2 * u;
        if (g != 0) {
            double f = (1 - g * g) / (1 - g + 2 * g * u);
            c = (1 + g * g - f * f) / (2 * g);
        }
        double s = std::sqrt(std::max(0.0, 1 - c * c)), phi = 2 * std::numbers::pi * rnd();
        double sc = s * std::cos(phi), ss = s * std::sin(phi);
        // Any frame around d: (ax, ay, az) and (bx, by, bz) (Duff et al. 2017)
        double sign = std::copysign(1.0, dz), a = -1 / (sign + dz), b = dx * dy * a;
        double nx = sc * (1 + sign * dx * dx * a) + ss * b + c * dx;
        double ny = sc * sign * b + ss * (sign + dy * dy * a) + c * dy;
        double nz = -sc * sign * dx - ss * dy + c * dz;
        double norm = 1 / std::sqrt(nx * nx + ny * ny + nz * nz);
        dx = nx * norm;
        dy = ny * norm;
        dz = nz * norm;
    }
    tally.n += 1; // cut: weight 0
}

Tally monteCarlo(uint64_t photons, Entry entry, double g, double ior, uint64_t seed)
{
    constexpr int kThreads = 2;
    Tally part[kThreads], all;
    std::vector<std::thread> threads;
    for (int t = 0; t < kThreads; ++t)
        threads.emplace_back([&, t] {
            Random rnd(seed * 64 + static_cast<uint64_t>(t));
            Tally tally;
            for (uint64_t i = 0; i < photons / kThreads; ++i) walk(tally, rnd, entry, g, ior);
            part[t] = tally;
        });
    for (std::thread& thread : threads) thread.join();
    for (const Tally& p : part) {
        all.n += p.n;
        for (size_t i = 0; i < kAlphas.size(); ++i) {
            all.w[i] += p.w[i];
            all.w2[i] += p.w2[i];
            all.wr[i] += p.wr[i];
        }
    }
    return all;
}

} // namespace

int main(int argc, char** argv)
{
    uint64_t photons = argc > 1 ? std::strtoull(argv[1], nullptr, 10) : 4000000;
    std::printf("# Reflectance of a half space\n\n"
                "Written by `tests/bench/cycles/slab_reference.cpp` (double precision, shares no code with the tracer), %llu photons per case.\n"
                "alpha = single-scattering albedo, g = Henyey-Greenstein. MC = Monte Carlo with its standard error; AD = adding-doubling; H = Chandrasekhar's\n"
                "H function (exact). AD is right to about 1e-6 where the boundary is index-matched, to 2e-5 where it is a dielectric (twice the nodes\n"
                "change it by that much); take AD as the value for tests.\n"
                "A random walk with cosine entry and Lambert exit (boundary `diffuse`) has the reflectance of the first table.\n\n",
                static_cast<unsigned long long>(photons));
    struct Case {
        const char* title;
        Entry entry;
        double ior;
    };
    const Case cases[] = {{"Index-matched boundary, cosine-distributed entry", Entry::kCosine, 1.0},
                          {"Index-matched boundary, normal incidence", Entry::kNormal, 1.0},
                          {"Smooth dielectric boundary n = 1.5, cosine-distributed light outside; mirror reflection included", Entry::kCosine, 1.5},
                          {"Smooth dielectric boundary n = 1.5, normal incidence; mirror reflection included", Entry::kNormal, 1.5}};
    uint64_t seed = 1;
    for (const Case& c : cases) {
        bool matched = c.ior == 1;
        std::printf("## %s\n\n| g | alpha | R (AD) | R (MC) | standard error | (MC - AD) / error |%s\n|---|---|---|---|---|---|%s\n", c.title,
                    matched ? " R (H) | mean exit distance / mfp (MC) |" : " without mirror (AD) |", matched ? "---|---|" : "---|");
        for (double g : {0.0, 0.5}) {
            Tally tally = monteCarlo(photons, c.entry, g, c.ior, seed++);
            for (size_t i = 0; i < kAlphas.size(); ++i) {
                double mean = tally.w[i] / tally.n, error = std::sqrt((tally.w2[i] / tally.n - mean * mean) / tally.n);
                Reflectance ad = addingDoubling(kAlphas[i], g, 1.5);
                HValues h = chandrasekhar(kAlphas[i]);
                bool cosine = c.entry == Entry::kCosine;
                double r = matched ? (cosine ? ad.cosine : ad.normal) : (cosine ? ad.dielectricCosine : ad.dielectricNormal);
                std::printf("| %.1f | %.3f | %.6f | %.5f | %.5f | %+.1f |", g, kAlphas[i], r, mean, error, (mean - r) / error);
                if (!matched) std::printf(" %.6f |\n", r - (cosine ? ad.mirrorCosine : ad.mirrorNormal));
                else if (g == 0) std::printf(" %.6f | %.4f |\n", cosine ? h.cosine : h.normal, tally.wr[i] / tally.w[i]);
                else std::printf(" | %.4f |\n", tally.wr[i] / tally.w[i]);
                std::fflush(stdout);
            }
        }
        std::printf("\n");
    }
    std::printf("## Diffuse reflectance to alpha: van de Hulst's formula against the exact value\n\n"
                "A = (1 - s)(1 - 0.139 s) / (1 + 1.17 s), s^2 = (1 - alpha) / (1 - g alpha), against the cosine-entry reflectance (AD).\n\n"
                "| g | alpha | A (formula) | R (AD) | difference |\n|---|---|---|---|---|\n");
    for (double g : {0.0, 0.5})
        for (double alpha : {0.2, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999}) {
            double s = std::sqrt((1 - alpha) / (1 - g * alpha)), a = (1 - s) * (1 - 0.139 * s) / (1 + 1.17 * s);
            double r = addingDoubling(alpha, g, 1.5).cosine;
            std::printf("| %.1f | %.3f | %.5f | %.5f | %+.5f |\n", g, alpha, a, r, a - r);
        }
    return 0;
}
