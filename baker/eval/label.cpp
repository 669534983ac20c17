// Letters of 5 x 9 pixels, the last two rows beneath the line.
#include "eval/label.h"

#include <algorithm>

namespace nacre {

namespace {

constexpr int kGlyphWidth = 5, kGlyphHeight = 9, kAdvance = kGlyphWidth + 1, kLeading = kGlyphHeight + 2, kMargin = 2;
constexpr int kLineLetters = 40; // at least, across a picture of many pixels
constexpr uint8_t kInk = 255;

struct Glyph { char letter; const char* rows; }; // top to bottom, each from the left

// What names and numbers of channels are written with.
constexpr Glyph kGlyphs[] = {
    {'0', ".###. #...# #..## #.#.# ##..# #...# .###. ..... ....."},
    {'1', "..#.. .##.. ..#.. ..#.. ..#.. ..#.. .###. ..... ....."},
    {'2', ".###. #...# ....# ..##. .#... #.... ##### ..... ....."},
    {'3', ".###. #...# ....# ..##. ....# #...# .###. ..... ....."},
    {'4', "...#. ..##. .#.#. #..#. ##### ...#. ...#. ..... ....."},
    {'5', "##### #.... ####. ....# ....# #...# .###. ..... ....."},
    {'6', "..##. .#... #.... ####. #...# #...# .###. ..... ....."},
    {'7', "##### ....# ...#. ...#. ..#.. ..#.. ..#.. ..... ....."},
    {'8', ".###. #...# #...# .###. #...# #...# .###. ..... ....."},
    {'9', ".###. #...# #...# .#### ....# ...#. .##.. ..... ....."},
    {'a', "..... ..... .###. ....# .#### #...# .#### ..... ....."},
    {'b', "#.... #.... ####. #...# #...# #...# ####. ..... ....."},
    {'c', "..... ..... .###. #...# #.... #...# .###. ..... ....."},
    {'d', "....# ....# .#### #...# #...# #...# .#### ..... ....."},
    {'e', "..... ..... .###. #...# ##### #.... .###. ..... ....."},
    {'f', "..##. .#... ####. .#... .#... .#... .#... ..... ....."},
    {'g', "..... ..... .#### #...# #...# #...# .#### ....# .###."},
    {'h', "#.... #.... ####. #...# #...# #...# #...# ..... ....."},
    {'i', "..#.. ..... .##.. ..#.. ..#.. ..#.. .###. ..... ....."},
    {'j', "...#. ..... ..##. ...#. ...#. ...#. ...#. #..#. .##.."},
    {'k', "#.... #.... #..#. #.#.. ##... #.#.. #..#. ..... ....."},
    {'l', ".##.. ..#.. ..#.. ..#.. ..#.. ..#.. .###. ..... ....."},
    {'m', "..... ..... ##.#. #.#.# #.#.# #.#.# #.#.# ..... ....."},
    {'n', "..... ..... ####. #...# #...# #...# #...# ..... ....."},
    {'o', "..... ..... .###. #...# #...# #...# .###. ..... ....."},
    {'p', "..... ..... ####. #...# #...# #...# ####. #.... #...."},
    {'q', "..... ..... .#### #...# #...# #...# .#### ....# ....#"},
    {'r', "..... ..... #.##. ##..# #.... #.... #.... ..... ....."},
    {'s', "..... ..... .#### #.... .###. ....# ####. ..... ....."},
    {'t', ".#... .#... ####. .#... .#... .#... ..##. ..... ....."},
    {'u', "..... ..... #...# #...# #...# #...# .#### ..... ....."},
    {'v', "..... ..... #...# #...# #...# .#.#. ..#.. ..... ....."},
    {'w', "..... ..... #...# #...# #.#.# #.#.# .#.#. ..... ....."},
    {'x', "..... ..... #...# .#.#. ..#.. .#.#. #...# ..... ....."},
    {'y', "..... ..... #...# #...# #...# #...# .#### ....# .###."},
    {'z', "..... ..... ##### ...#. ..#.. .#... ##### ..... ....."},
    {'T', "##### ..#.. ..#.. ..#.. ..#.. ..#.. ..#.. ..... ....."},
    {'.', "..... ..... ..... ..... ..... .##.. .##.. ..... ....."},
    {',', "..... ..... ..... ..... ..... .##.. .##.. .#... ....."},
    {'-', "..... ..... ..... .###. ..... ..... ..... ..... ....."},
    {'+', "..... ..#.. ..#.. ##### ..#.. ..#.. ..... ..... ....."},
    {'_', "..... ..... ..... ..... ..... ..... ..... ##### ....."},
    {':', "..... .##.. .##.. ..... .##.. .##.. ..... ..... ....."},
    {'/', "....# ....# ...#. ..#.. .#... #.... #.... ..... ....."},
    {'(', "...#. ..#.. .#... .#... .#... ..#.. ...#. ..... ....."},
    {')', ".#... ..#.. ...#. ...#. ...#. ..#.. .#... ..... ....."},
};
constexpr const char* kUnknown = "##### #...# #...# #...# #...# #...# ##### ..... .....";

const char* rowsOf(char letter)
{
    for (const Glyph& g : kGlyphs)
        if (g.letter == letter) return g.rows;
    return kUnknown;
}

void draw(char letter, int x0, int y0, int scale, Picture& out)
{
    if (letter == ' ') return;
    const char* rows = rowsOf(letter);
    for (int y = 0; y < kGlyphHeight * scale; ++y)
        for (int x = 0; x < kGlyphWidth * scale; ++x)
            if (rows[(kGlyphWidth + 1) * (y / scale) + x / scale] == '#') std::fill_n(&out.rgb[3 * (size_t(out.width) * size_t(y0 + y) + size_t(x0 + x))], 3, kInk);
}

} // namespace

Picture labelled(const Picture& picture, std::span<const std::string> lines)
{
    const int scale = std::max(1, picture.width / (kAdvance * kLineLetters)), band = (int(lines.size()) * kLeading + 1) * scale;
    Picture out{picture.width, picture.height + band, {}};
    for (const std::string& line : lines) out.width = std::max(out.width, (2 * kMargin + int(line.size()) * kAdvance) * scale);
    out.rgb.resize(size_t(3) * out.width * out.height);
    for (size_t line = 0; line < lines.size(); ++line)
        for (size_t i = 0; i < lines[line].size(); ++i)
            draw(lines[line][i], scale * (kMargin + int(i) * kAdvance), scale * (1 + int(line) * kLeading), scale, out);
    for (int y = 0; y < picture.height; ++y)
        std::copy_n(&picture.rgb[size_t(3) * picture.width * y], size_t(3) * picture.width, &out.rgb[size_t(3) * out.width * (band + y)]);
    return out;
}

} // namespace nacre
