// A folder of small photographs: cameras on a ring, each with some lights above it, a plain rectangle in each image.
#pragma once

#include "dataset/olat_dataset.h"
#include "interchange/png.h"

#include <doctest/doctest.h>
#include <glm/gtc/matrix_transform.hpp>

#include <array>
#include <filesystem>
#include <string>
#include <vector>

struct PhotographFolder {
    std::filesystem::path path;
    nacre::OlatDataset dataset;
    PhotographFolder(const char* name, int size, uint32_t cameras, uint32_t lights) : path(std::filesystem::temp_directory_path() / name)
    {
        std::filesystem::remove_all(path), std::filesystem::create_directories(path);
        dataset.convention = "canonical", dataset.path = path.string(), dataset.colorSpace = nacre::ColorSpace::kSrgb;
        nacre::OlatSplit& split = dataset.splits.emplace_back();
        split.name = "train";
        for (uint32_t i = 0; i < cameras; ++i) {
            nacre::Camera c;
            c.width = c.height = size, c.fx = c.fy = 20, c.cx = c.cy = size / 2;
            const glm::dvec3 eye(3 * std::cos(0.5 * i), 3 * std::sin(0.5 * i), 1.0);
            c.worldFromCamera = glm::inverse(glm::lookAt(eye, glm::dvec3(0), glm::dvec3(0, 0, 1)));
            split.cameras.push_back(c);
            for (uint32_t l = 1; l <= lights; ++l) {
                nacre::Light light;
                light.position = glm::vec3(eye) + glm::vec3(0, 0, 0.5f * float(l)), light.intensity = glm::vec3(10);
                split.images.push_back({i, light, file(std::to_string(split.images.size()) + ".png")});
                write(uint32_t(split.images.size() - 1), size, grey(uint8_t(80 + 10 * i + 40 * (l - 1))));
            }
        }
    }
    ~PhotographFolder() { std::filesystem::remove_all(path); }
    PhotographFolder(const PhotographFolder&) = delete;
    PhotographFolder& operator=(const PhotographFolder&) = delete;

    static std::array<uint8_t, 3> grey(uint8_t value) { return {value, value, value}; }
    nacre::OlatSplit& train() { return dataset.splits[0]; }
    std::string file(const std::string& name) const { return (path / name).string(); }
    void write(uint32_t i, int size, std::array<uint8_t, 3> colour) const
    {
        std::vector<uint8_t> rgba(size_t(4 * size * size));
        for (int y = 8; y < 13; ++y)
            for (int x = 6; x < 14; ++x) {
                uint8_t* p = &rgba[4 * size_t(y * size + x)];
                p[0] = colour[0], p[1] = colour[1], p[2] = colour[2], p[3] = 255;
            }
        REQUIRE(bool(nacre::writePng(dataset.splits[0].images[i].path, size, size, 4, rgba)));
    }
};
