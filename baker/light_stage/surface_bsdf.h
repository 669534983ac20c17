// How a surface point scatters: the glTF 2.0 material model (appendix B) with KHR_materials_specular, ior, anisotropy, clearcoat,
// transmission and iridescence, exactly as the specifications write it:
//
//   material   = mix(dielectric, metal, metallic)
//   metal      = (c + (1 - c)(1 - V.H)^5) specular(alpha),                                    c = base colour
//   dielectric = (1 - w max(F)) base + w F specular(alpha),  F = F0 + (1 - F0)(1 - V.H)^5,    w = specular factor
//   base       = mix(c / pi, c * transmitted specular, transmission)
//   coated     = mix(material, specular(alpha_c), clearcoat (0.04 + 0.96 (1 - Nc.V)^5))       (not reciprocal: only V counts)
// Under a thin film, F and the metal's term become mix(F, reflectance of the film, iridescence).
//
// Where the mesh bounds a volume, the transmission lobe refracts (Walter et al. 2007) and F is the exact dielectric Fresnel term,
// which knows total internal reflection. Radiance is not scaled by ior^2 at the boundary: lights and cameras are outside, where
// the factors cancel.
#pragma once

#include "light_stage/thin_film.h"

namespace nacre::stage {

struct SurfaceBsdf {
    Frame frame;               // shading frame, n on the side of wo
    glm::vec3 ng{0, 0, 1};     // geometric normal, on the side of wo
    glm::vec3 wo{0, 0, 1};     // in the shading frame, z > 0
    glm::vec3 above{0, 0, 1};  // tells reflection from transmission: ng, or the interpolated normal where the surface it describes bulges over the triangle
    glm::vec3 baseColor{1.0f};
    glm::vec3 diffuse{0.0f};   // (1 - transmission) base colour; 0 if a random walk replaces it
    glm::vec3 f0{0.04f};
    float specular = 1.0f, metallic = 0.0f, transmission = 0.0f;
    float alphaX = 1.0f, alphaY = 1.0f;
    float eta = 1.0f;          // ior of the far side over that of wo's side; 1: thin wall, light goes straight through
    float film = 0.0f, filmIor = 1.3f, filmThickness = 0.0f; // iridescence factor; nanometres
    float coat = 0.0f, coatAlpha = 0.0f;
    Frame coatFrame;
    glm::vec3 coatWo{0, 0, 1};
    // Chances of the lobes in sample(); they add up to 1.
    float chanceSpecular = 0, chanceDiffuse = 0, chanceTransmit = 0, chanceCoat = 0;
    float coatShare = 0.0f;    // clearcoat (0.04 + 0.96 (1 - Nc.V)^5)

    bool solid() const { return eta != 1.0f; }
    /// True when only the diffuse lobe is there: f = diffuse / pi.
    bool lambertian() const { return specular == 0.0f && metallic == 0.0f && transmission == 0.0f && coat == 0.0f; }

    void roughen(float leastAlpha)
    {
        alphaX = std::max(alphaX, leastAlpha);
        alphaY = std::max(alphaY, leastAlpha);
        coatAlpha = std::max(coatAlpha, leastAlpha);
    }

    glm::vec3 dielectricFresnel(float cosine) const
    {
        return underFilm(solid() ? glm::vec3(fresnelDielectric(cosine, eta)) : f0 + (1.0f - f0) * schlickWeight(cosine), f0, cosine);
    }
    glm::vec3 metalFresnel(float cosine) const { return underFilm(baseColor + (1.0f - baseColor) * schlickWeight(cosine), baseColor, cosine); }

    /// Call when everything else is set. `subsurface` gets the chance of entering a random walk of that albedo, relative to the rest.
    void finish(const glm::vec3& subsurfaceAlbedo, float* chanceSubsurface)
    {
        const glm::vec3 fresnel = specular * dielectricFresnel(wo.z);
        const float below = (1.0f - metallic) * (1.0f - maxOf(fresnel));
        coatShare = coat * (0.04f + 0.96f * schlickWeight(std::fabs(coatWo.z)));
        const float under = 1.0f - coatShare;
        float s = under * luminance(metallic * metalFresnel(wo.z) + (1.0f - metallic) * fresnel);
        const float d = under * below * luminance(diffuse), t = under * below * transmission * luminance(baseColor);
        const float walk = under * below * luminance(subsurfaceAlbedo);
        // A lobe that is there must never have chance 0: Fresnel at a microfacet may exceed its value at the mean normal.
        if (specular > 0.0f || metallic > 0.0f) s = std::max(s, 0.02f * (d + t + walk + coatShare));
        const float local = s + d + t + coatShare, scale = local > 0.0f ? 1.0f / local : 0.0f;
        *chanceSubsurface = walk > 0.0f ? walk / (walk + local) : 0.0f;
        chanceSpecular = s * scale;
        chanceDiffuse = d * scale;
        chanceTransmit = t * scale;
        chanceCoat = coatShare * scale;
    }

    /// f(wo, wi) |cos wi|, wi in world space on either side.
    glm::vec3 evaluate(const glm::vec3& wiWorld) const
    {
        const glm::vec3 wi = frame.toLocal(wiWorld);
        const bool reflected = glm::dot(wiWorld, above) > 0.0f;
        if (reflected != (wi.z > 0.0f)) return glm::vec3(0.0f); // the two normals disagree about the side: no light
        glm::vec3 f(0.0f);
        if (reflected) {
            const glm::vec3 h = glm::normalize(wo + wi);
            const float voh = glm::dot(wo, h);
            const glm::vec3 fresnel = specular * dielectricFresnel(voh);
            f = (1.0f - metallic) * (1.0f - maxOf(fresnel)) * kInvPi * diffuse;
            if (specular > 0.0f || metallic > 0.0f) {
                const glm::vec3 tint = metallic * metalFresnel(voh) + (1.0f - metallic) * fresnel;
                f += tint * ggxReflection(wo, wi, h, alphaX, alphaY);
            }
            f *= wi.z;
            if (coat > 0.0f) {
                f *= 1.0f - coatShare;
                const glm::vec3 ci = coatFrame.toLocal(wiWorld);
                if (ci.z > 0.0f && coatWo.z > 0.0f)
                    f += coatShare * ci.z * ggxReflection(coatWo, ci, glm::normalize(coatWo + ci), coatAlpha, coatAlpha);
            }
            return f;
        }
        if (transmission == 0.0f) return f;
        const glm::vec3 tint = (1.0f - coatShare) * (1.0f - metallic) * transmission * baseColor;
        if (!solid()) { // a thin wall: the reflection lobe, mirrored through the surface
            const glm::vec3 mirrored(wi.x, wi.y, -wi.z), h = glm::normalize(wo + mirrored);
            const float through = 1.0f - maxOf(specular * dielectricFresnel(glm::dot(wo, h)));
            return tint * (through * ggxReflection(wo, mirrored, h, alphaX, alphaY) * mirrored.z);
        }
        glm::vec3 h;
        if (!refractionHalfVector(wi, &h)) return f;
        const float oh = glm::dot(wo, h), ih = glm::dot(wi, h);
        const glm::vec3 through = 1.0f - specular * dielectricFresnel(oh);
        const float d = ggxD(h, alphaX, alphaY) * ggxG1(wo, alphaX, alphaY) * ggxG1(wi, alphaX, alphaY);
        return tint * (through * d * std::fabs(oh * ih) / (wo.z * sqr(oh / eta + ih))); // Walter et al. 2007, eq. 21, times |cos wi|
    }

    /// Density of sample(), per solid angle.
    float pdf(const glm::vec3& wiWorld) const
    {
        const glm::vec3 wi = frame.toLocal(wiWorld);
        const bool reflected = glm::dot(wiWorld, above) > 0.0f;
        if (reflected != (wi.z > 0.0f)) return 0.0f;
        if (reflected) {
            float p = chanceDiffuse * wi.z * kInvPi;
            if (chanceSpecular > 0.0f) p += chanceSpecular * ggxReflectionPdf(wo, glm::normalize(wo + wi), alphaX, alphaY);
            if (chanceCoat > 0.0f) {
                const glm::vec3 ci = coatFrame.toLocal(wiWorld);
                if (ci.z > 0.0f && coatWo.z > 0.0f)
                    p += chanceCoat * ggxReflectionPdf(coatWo, glm::normalize(coatWo + ci), coatAlpha, coatAlpha);
            }
            return p;
        }
        if (chanceTransmit == 0.0f) return 0.0f;
        if (!solid()) return chanceTransmit * ggxReflectionPdf(wo, glm::normalize(wo + glm::vec3(wi.x, wi.y, -wi.z)), alphaX, alphaY);
        glm::vec3 h;
        if (!refractionHalfVector(wi, &h)) return 0.0f;
        const float oh = glm::dot(wo, h), ih = glm::dot(wi, h);
        const float visible = ggxD(h, alphaX, alphaY) * ggxG1(wo, alphaX, alphaY) * std::fabs(oh) / wo.z;
        return chanceTransmit * visible * std::fabs(ih) / sqr(oh / eta + ih);
    }

    /// Draws wi (world). False: absorbed (or drawn below the surface). weight = f |cos| / pdf.
    bool sample(float uLobe, const glm::vec2& u, glm::vec3* wiWorld, glm::vec3* weight, float* density) const
    {
        if (uLobe < chanceDiffuse) {
            *wiWorld = frame.toWorld(sampleCosine(u));
        } else if (uLobe < chanceDiffuse + chanceSpecular) {
            const glm::vec3 h = sampleVisibleNormal(wo, alphaX, alphaY, u);
            *wiWorld = frame.toWorld(2.0f * glm::dot(wo, h) * h - wo);
        } else if (uLobe < chanceDiffuse + chanceSpecular + chanceTransmit) {
            const glm::vec3 h = sampleVisibleNormal(wo, alphaX, alphaY, u);
            const float oh = glm::dot(wo, h);
            glm::vec3 wi = 2.0f * oh * h - wo;
            if (!solid()) {
                wi.z = -wi.z;
            } else {
                const float cos2 = 1.0f - (1.0f - oh * oh) / (eta * eta);
                if (cos2 <= 0.0f) return false; // total internal reflection: the specular lobe has it
                wi = (oh / eta - std::sqrt(cos2)) * h - wo / eta;
            }
            *wiWorld = frame.toWorld(wi);
        } else if (chanceCoat > 0.0f && coatWo.z > 0.0f) {
            const glm::vec3 h = sampleVisibleNormal(coatWo, coatAlpha, coatAlpha, u);
            *wiWorld = coatFrame.toWorld(2.0f * glm::dot(coatWo, h) * h - coatWo);
        } else {
            return false;
        }
        *wiWorld = glm::normalize(*wiWorld);
        *density = pdf(*wiWorld);
        if (!(*density > 0.0f)) return false;
        *weight = evaluate(*wiWorld) / *density;
        return true;
    }

private:
    glm::vec3 underFilm(const glm::vec3& bare, const glm::vec3& bareF0, float cosine) const
    {
        if (film == 0.0f) return bare;
        if (eta < 1.0f) cosine = std::sqrt(std::max(0.0f, 1.0f - (1.0f - cosine * cosine) / (eta * eta))); // seen from within: what the outside sees
        return glm::mix(bare, thinFilmReflectance(cosine, filmIor, filmThickness, bareF0), film);
    }

    /// The microfacet normal, on wo's side, that refracts wo into wi.
    bool refractionHalfVector(const glm::vec3& wi, glm::vec3* h) const
    {
        const glm::vec3 v = -(wo + eta * wi);
        const float length = glm::length(v);
        if (!(length > 1e-8f)) return false;
        *h = v / length;
        if (h->z < 0.0f) *h = -*h;
        return glm::dot(wo, *h) > 0.0f && glm::dot(wi, *h) < 0.0f;
    }
};

} // namespace nacre::stage
