// What every loader keeps, whatever bytes it gets: a dataset as olat_dataset.h promises it, or an error of one line.
#pragma once

#include "dataset/loader.h"

#include <cmath>
#include <cstdlib>

inline void require(bool condition)
{
    if (!condition) std::abort();
}

inline void requireLine(const nacre::Error& error)
{
    require(!error.message.empty() && error.message.size() < 3000 && error.message.find('\n') == std::string::npos);
}

inline void requirePromises(const nacre::Result<nacre::OlatDataset>& dataset)
{
    if (!dataset) return requireLine(dataset.error());
    require(!dataset->splits.empty());
    for (const nacre::OlatSplit& split : dataset->splits) {
        require(!split.images.empty() && (split.files.empty() || split.files.size() == split.cameras.size()));
        for (const nacre::Camera& c : split.cameras) {
            require(c.width > 0 && c.height > 0 && c.fx > 0 && c.fy > 0 && std::isfinite(c.cx) && std::isfinite(c.cy));
            const glm::dmat3 r(c.worldFromCamera), gram = glm::transpose(r) * r;
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) require(std::fabs(gram[i][j] - (i == j ? 1.0 : 0.0)) < 1e-9);
            require(glm::determinant(r) > 0 && glm::length(c.position()) < 2e9);
        }
        for (const nacre::FileCamera& f : split.files)
            for (const double k : {f.k[0], f.k[1], f.k[2], f.k[3], f.k[4], f.k[5], f.p[0], f.p[1]}) require(std::isfinite(k));
        for (const nacre::OlatImage& image : split.images) {
            require(image.camera < split.cameras.size());
            for (int i = 0; i < 3; i++)
                require(std::isfinite(image.light.position[i]) && std::isfinite(image.light.directionToLight[i]) && std::isfinite(image.light.intensity[i]) &&
                        image.light.intensity[i] >= 0 && std::isfinite(image.gain[i]) && image.gain[i] > 0);
        }
    }
}
