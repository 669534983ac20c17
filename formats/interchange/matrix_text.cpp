// Numbers in text: OpenCV's YAML as far as calibrations go, and plain matrices.
#include "interchange/matrix_file.h"

#include "base/text.h"
#include "interchange/text_lines.h"

#include <algorithm>
#include <cctype>

namespace nacre {

Result<std::map<std::string, std::vector<double>>> decodeYamlNumbers(std::span<const std::byte> bytes, const std::string& name)
{
    constexpr size_t kMaxBytes = size_t(1) << 20;
    if (bytes.size() > kMaxBytes) return Error{ErrorCode::kBadInput, name + ": " + std::to_string(bytes.size()) + " bytes, expected a calibration of at most a megabyte"};
    std::map<std::string, std::vector<double>> out;
    std::string_view text = asText(bytes), line;
    std::string key, owner; // whose numbers these are; the last key that is not of a matrix's own
    const auto isWord = [](char c) { return std::isalnum(static_cast<unsigned char>(c)) || c == '_'; };
    while (nextLine(text, line)) {
        if (line.starts_with('%') || line.starts_with("---") || line.starts_with("...")) continue;
        line = line.substr(0, line.find('#'));
        for (size_t at = 0; at < line.size();) {
            if (std::string_view(" \t,[]{}\"'").find(line[at]) != std::string_view::npos || (line[at] == '-' && (at + 1 == line.size() || line[at + 1] == ' '))) {
                ++at;
                continue;
            }
            size_t end = std::min(line.find_first_of(" \t,[]{}\"':", at), line.size());
            const std::string_view word = line.substr(at, end - at);
            while (end < line.size() && (line[end] == '"' || line[end] == '\'')) ++end; // a key in quotes
            if (end < line.size() && line[end] == ':' && !word.empty() && std::all_of(word.begin(), word.end(), isWord)) {
                const bool isShape = word == "rows" || word == "cols" || word == "dt";
                if (!isShape && word != "data") owner = std::string(word);
                key = isShape ? "" : owner; // `data` of a matrix of OpenCV's are those of the key that it belongs to
                at = end + 1;
                continue;
            }
            if (const std::optional<double> x = numberOf(word); x && !key.empty()) out[key].push_back(*x);
            at = std::max(end, at + 1);
        }
    }
    return out;
}

Result<Matrix> decodeTextMatrix(std::span<const std::byte> bytes, const std::string& name)
{
    Matrix out;
    std::string_view text = asText(bytes), line;
    for (size_t number = 1; nextLine(text, line); ++number) {
        line = trimmed(line.substr(0, line.find('#')));
        if (line.empty()) continue;
        const auto row = numbersOf(line);
        const auto bad = [&](const std::string& what) { return Error{ErrorCode::kBadInput, name + ": line " + std::to_string(number) + ": " + what}; };
        if (!row) return bad("expected numbers, found " + inQuotes(line));
        if (out.rows > 0 && row->size() != out.columns) return bad(std::to_string(row->size()) + " numbers, expected " + std::to_string(out.columns) + " as in the first line");
        out.columns = row->size();
        out.rows++;
        out.values.insert(out.values.end(), row->begin(), row->end());
    }
    if (out.rows == 0) return Error{ErrorCode::kBadInput, name + ": no numbers"};
    return out;
}

} // namespace nacre
