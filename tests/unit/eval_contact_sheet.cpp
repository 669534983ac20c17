#include "eval/contact_sheet.h"

#include <doctest/doctest.h>

#include <array>

using namespace nacre;

static Image flat(int width, int height, float r, float g, float b)
{
    Image image{width, height, {}};
    for (int i = 0; i < width * height; ++i) image.rgba.insert(image.rgba.end(), {r, g, b, 1.0f});
    return image;
}

static std::array<int, 3> at(const Picture& p, int x, int y)
{
    const uint8_t* rgb = &p.rgb[3 * (size_t(y) * p.width + x)];
    return {rgb[0], rgb[1], rgb[2]};
}

TEST_CASE("a display picture is clamped, sRGB-encoded and rounded")
{
    const Picture p = displayPicture(flat(2, 3, -1.0f, 0.5f, 7.0f));
    CHECK(p.width == 2);
    CHECK(p.height == 3);
    CHECK(at(p, 1, 2) == std::array<int, 3>{0, 188, 255}); // Γ(0.5) = 0.7354
}

TEST_CASE("a contact row shows reference, render and four times the encoded error")
{
    // Γ(0.5) = 0.73536, Γ(0.4) = 0.66519: 4 * 0.07017 * 255 = 71.6
    const Picture row = contactRow(flat(8, 4, 0.5f, 0.0f, 1.0f), flat(8, 4, 0.4f, 0.0f, 0.0f));
    CHECK(row.height == 4);
    CHECK(row.width > 24); // three parts and separators
    CHECK(at(row, 0, 0) == std::array<int, 3>{188, 0, 255});
    CHECK(at(row, row.width / 2, 0) == std::array<int, 3>{170, 0, 0});
    CHECK(at(row, row.width - 1, 3) == std::array<int, 3>{72, 0, 255});
}

TEST_CASE("tiling keeps reading order and takes pictures of different sizes")
{
    const Picture pictures[] = {displayPicture(flat(4, 4, 1, 0, 0)), displayPicture(flat(2, 6, 0, 1, 0)), displayPicture(flat(4, 2, 0, 0, 1))};
    const Picture sheet = tile(pictures, 2);
    CHECK(at(sheet, 0, 0) == std::array<int, 3>{255, 0, 0});
    CHECK(at(sheet, sheet.width - 4, 5) == std::array<int, 3>{0, 255, 0});
    CHECK(at(sheet, 0, sheet.height - 6) == std::array<int, 3>{0, 0, 255});
    CHECK(tile(pictures, 9).height == 6);
    CHECK(tile({}, 2).rgb.empty());
}
