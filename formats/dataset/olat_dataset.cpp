// Finds the description files of a dataset folder, picks the loader and checks what it made.
#include "dataset/loader.h"
#include "dataset/packed_images.h"

#include "base/file.h"
#include "interchange/image_file.h"

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <tuple>

namespace nacre {
namespace {

namespace fs = std::filesystem;

struct Loader {
    const char* convention;
    bool (*detect)(const DatasetSource&);
    Status (*load)(const DatasetSource&, OlatDataset&);
};

constexpr Loader kLoaders[] = { // the first that recognises its marks wins
    {"bigs", isBigs, loadBigs},
    {"sssgs", isSssgs, loadSssgs},
    {"plpos", isPlpos, loadPlpos},
    {"canonical", isCanonical, loadCanonical},
    {"nerf", isNerf, loadNerf},
    {"openillumination", isOpenIllumination, loadOpenIllumination},
    {"diligent-mv", isDiligent, loadDiligent},
    {"rene", isRene, loadRene},
    {"colmap", isColmap, loadColmap},
};

constexpr const char* kLoneFile = "transforms.json"; // one file for all that there is: a train set
constexpr const char* kLightTable = "lights.json";
constexpr size_t kMaxJsonBytes = size_t(1) << 28; // the largest published set needs about 20 MB

Result<Description> readDescription(const DatasetSource& source, const std::string& folder, const std::string& fileName)
{
    const std::string path = (fs::path(source.path) / folder / fileName).string();
    const Result<std::vector<std::byte>> text = readFile(path, kMaxJsonBytes);
    if (!text) return text.error();
    const Result<JsonDocument> json = JsonDocument::parse(*text, path);
    if (!json) return json.error();
    std::string split = fileName == kLoneFile || fileName == kLightTable ? "train" : fs::path(fileName).stem().string();
    if (split.starts_with("transforms_")) split.erase(0, std::string("transforms_").size());
    return Description{folder, split, *json};
}

Status addDescription(DatasetSource& source, const std::string& folder, const std::string& fileName)
{
    Result<Description> description = readDescription(source, folder, fileName);
    if (!description) return description.error();
    source.descriptions.push_back(std::move(*description));
    return ok();
}

std::vector<std::string> namesIn(const std::string& folder)
{
    std::vector<std::string> names;
    std::error_code ec;
    for (fs::directory_iterator it(folder, ec), end; !ec && it != end; it.increment(ec)) names.push_back(it->path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
}

/// Train first, test second, then by name: what a person expects to read, and the same on every file system.
std::tuple<int, std::string> splitOrder(const std::string& fileName)
{
    return {fileName == "transforms_train.json" || fileName == kLoneFile ? 0 : fileName == "transforms_test.json" ? 1 : 2, fileName};
}

struct Listing {
    std::vector<std::string> files;                        // transforms_*.json
    std::vector<std::pair<int, std::string>> lightFolders; // olat_<i>, by number
    std::string other;                                     // some other .json: a hint at what was meant
};

Result<Listing> listFolder(const std::string& path)
{
    Listing out;
    std::error_code ec;
    if (!fs::is_directory(path, ec))
        return Error{ErrorCode::kBadInput, inQuotes(path) + " is not a folder; expected that of a dataset"};
    for (fs::directory_iterator it(path, ec), end; !ec && it != end; it.increment(ec)) {
        const std::string name = it->path().filename().string();
        if ((name.starts_with("transforms_") && name.ends_with(".json")) || name == kLoneFile) out.files.push_back(name);
        else if (name.ends_with(".json") && name != kLightTable && (out.other.empty() || name < out.other)) out.other = name;
        if (!name.starts_with("olat_")) continue;
        int light = 0;
        const auto [last, status] = std::from_chars(name.data() + 5, name.data() + name.size(), light);
        if (status == std::errc() && last == name.data() + name.size()) out.lightFolders.emplace_back(light, name);
    }
    if (ec) return Error{ErrorCode::kBadInput, inQuotes(path) + ": cannot list the folder: " + ec.message()};
    if (std::count(out.files.begin(), out.files.end(), "transforms_train.json")) std::erase(out.files, kLoneFile);
    std::sort(out.files.begin(), out.files.end(), [](const auto& a, const auto& b) { return splitOrder(a) < splitOrder(b); });
    std::sort(out.lightFolders.begin(), out.lightFolders.end());
    return out;
}

/// `path` is the folder, or one description file of it: then that is the only split.
Result<DatasetSource> readSource(const std::string& path)
{
    std::error_code ec;
    DatasetSource source;
    source.path = path;
    source.fileExists = [](const std::string& p) { std::error_code e; return fs::is_regular_file(p, e); };
    source.readImageSize = readImageFileSize;
    source.list = namesIn;
    source.readFile = [](const std::string& p) { return readFile(p); };
    if (extensionOf(path) == ".json" && fs::is_regular_file(path, ec)) {
        source.path = fs::path(path).parent_path().string();
        if (Status s = addDescription(source, "", fs::path(path).filename().string()); !s) return s.error();
    } else {
        const Result<Listing> listing = listFolder(path);
        if (!listing) return listing.error();
        for (const std::string& file : listing->files)
            if (Status s = addDescription(source, "", file); !s) return s.error();
        if (listing->files.empty() && listing->lightFolders.empty() && std::none_of(std::begin(kLoaders), std::end(kLoaders), [&](const Loader& l) { return l.detect(source); }))
            return Error{ErrorCode::kBadInput, inQuotes(path) + ": no transforms_<split>.json, no olat_<i> folders, no COLMAP model and no other known layout; not a dataset folder" +
                                                   (listing->other.empty() ? "" : " (it has " + inQuotes(listing->other) +
                                                    "; rename it to transforms_train.json, or give that file)")};
        if (listing->files.empty())
            for (const auto& [light, folder] : listing->lightFolders)
                if (Status s = addDescription(source, folder, "transforms_train.json"); !s) return s.error();
    }

    if (fs::is_regular_file(source.pathOf(kLightTable), ec)) {
        const Result<Description> lights = readDescription(source, "", kLightTable);
        if (!lights) return lights.error();
        source.lights = *lights;
    }
    const std::string excludePath = (fs::path(source.path) / "exclude_list.txt").string();
    if (fs::is_regular_file(excludePath, ec)) {
        const Result<std::vector<std::byte>> text = readFile(excludePath, kMaxJsonBytes);
        if (!text) return text.error();
        source.excludeList.assign(reinterpret_cast<const char*>(text->data()), text->size());
    }
    return source;
}

/// Counted, and the first named. A few files that are gone are left to those who load images: they go on without.
Status checkMissing(const DatasetSource& source, OlatDataset& dataset)
{
    if (source.missing.count == 0) return ok();
    size_t images = 0;
    for (const OlatSplit& split : dataset.splits) images += split.images.size();
    const std::string what = "no file " + inQuotes(source.missing.path) + "; " + std::to_string(source.missing.count) + " of " +
                             std::to_string(images) + " images are missing";
    if (3 * source.missing.count <= images) {
        dataset.warnings.push_back(what);
        return ok();
    }
    if (!source.missing.first.exists()) return Error{ErrorCode::kBadInput, inQuotes(source.path) + ": " + what};
    source.missing.first.fail("an existing file", what);
    return source.firstMismatch();
}

/// A photograph without a mask says that all it shows is the object.
void checkMasks(OlatDataset& dataset)
{
    for (const OlatSplit& split : dataset.splits) {
        const auto isBare = [](const OlatImage& image) { return image.maskPath.empty(); };
        const auto bare = std::count_if(split.images.begin(), split.images.end(), isBare);
        if (bare == 0 || size_t(bare) == split.images.size()) continue;
        dataset.warnings.push_back(std::to_string(bare) + " of " + std::to_string(split.images.size()) + " images of split " + inQuotes(split.name) + " have no mask, unlike the others; the first is " +
                                   inQuotes(std::find_if(split.images.begin(), split.images.end(), isBare)->path) +
                                   ": their own alpha counts, which is 1 everywhere in a photograph; give all of them masks, or leave them out");
    }
}

/// Each file goes by its kind, unless the description says otherwise. Only formats that ImageCache reads.
Status decideColors(const DatasetSource& source, OlatDataset& dataset)
{
    size_t display = 0, jpeg = 0, exr = 0; // PNG and JPEG; JPEG alone; EXR
    const OlatImage* firstExr = nullptr;
    bool mixed = false; // within a split: photographs to train and renders to measure are two
    for (const OlatSplit& split : dataset.splits) {
        const size_t exrBefore = exr;
        for (const OlatImage& image : split.images) {
            const ImageKind kind = imageKind(image.path);
            if (kind == ImageKind::kNone)
                return Error{ErrorCode::kUnsupported, "image " + inQuotes(image.path) + ": expected .exr, .png or .jpg; convert it first"};
            ++(kind == ImageKind::kExr ? exr : display);
            if (kind == ImageKind::kJpeg) ++jpeg;
            if (kind == ImageKind::kExr && !firstExr) firstExr = &image;
        }
        mixed = mixed || (exr > exrBefore && exr - exrBefore < split.images.size());
    }
    const FileColors said = readFileColors(source);
    readCapture(source, dataset);
    if (Status s = source.firstMismatch(); !s) return s;
    if (display == 0 && said.colorSpace == ColorSpace::kSrgb)
        return Error{ErrorCode::kBadInput, "image " + inQuotes(firstExr->path) + ": an EXR in a dataset with color_space srgb; EXR is linear"};
    if (display == 0) dataset.colorSpace = ColorSpace::kLinear;
    else if (said.colorSpace) dataset.colorSpace = *said.colorSpace;
    dataset.colorSpaceIsGuess = !said.colorSpace && dataset.colorSpace == ColorSpace::kSrgb; // a convention of linear PNG is none
    if (said.premultiplied) dataset.premultiplied = *said.premultiplied, dataset.straightPng = false;
    if (exr == 0 && dataset.straightPng) dataset.premultiplied = false;
    if (exr == 0 || display == 0) dataset.straightPng = false;

    const char* names = jpeg == 0 ? "PNG" : jpeg == display ? "JPEG" : "PNG and JPEG";
    if (!said.colorSpace && display > 0 && dataset.convention == "canonical")
        dataset.warnings.push_back(std::string("no color_space: ") + names + " images are taken as sRGB; write \"color_space\": \"srgb\" or \"linear\" into " +
                                   source.descriptions[0].json.name());
    if (display > 0 && exr > 0 && (mixed || !said.colorSpace))
        dataset.warnings.push_back(std::to_string(display) + " " + names + " images are read as " + (dataset.colorSpace == ColorSpace::kSrgb ? "sRGB" : "linear") +
                                   ", " + std::to_string(exr) + " EXR images as linear: the dataset mixes them");
    return ok();
}

} // namespace

Result<OlatDataset> loadFrom(const DatasetSource& source)
{
    for (const Description& d : source.descriptions) // a broken "frames" is a better message than "not recognised"
        if (d.frames().items().empty()) {
            d.frames().fail("at least one frame", "an empty split");
            return d.json.error();
        }
    for (const Loader& loader : kLoaders) {
        if (!loader.detect(source)) continue;
        OlatDataset dataset;
        dataset.path = source.path;
        dataset.convention = loader.convention;
        source.missing = {}, source.lastSize = {};
        if (Status s = loader.load(source, dataset); !s) return s.error();
        if (dataset.splits.empty()) return Error{ErrorCode::kBadInput, inQuotes(source.path) + ": no split has images"};
        for (const OlatSplit& split : dataset.splits)
            if (split.images.empty())
                return Error{ErrorCode::kBadInput, inQuotes(source.path) + ": split " + inQuotes(split.name) + " is empty, expected at least one image"};
        if (Status s = checkMissing(source, dataset); !s) return s.error();
        if (Status s = decideColors(source, dataset); !s) return s.error();
        if (Status s = checkSizes(source, dataset); !s) return s.error();
        checkIntrinsics(dataset);
        checkMasks(dataset);
        return dataset;
    }
    return Error{ErrorCode::kBadInput, inQuotes(source.path) + ": frames have none of the keys light, light_position, light_direction, pl_pos, file_paths, and there is no lights.csv or "
                                                               "lights.json; unknown dataset convention"};
}

Result<OlatDataset> loadDataset(const std::string& path)
{
    std::error_code ignored;
    const fs::path folder = fs::path(path).filename() == kPackedDescription ? fs::path(path).parent_path() : fs::path(path);
    if (fs::is_regular_file(folder / kPackedDescription, ignored)) return loadPacked(folder.string());
    if (fs::is_regular_file(folder / kPackedJournal, ignored))
        return Error{ErrorCode::kBadInput, inQuotes(path) + ": left of a nacre prepare that was interrupted; give the same command again to complete it"};
    const Result<DatasetSource> source = readSource(path);
    if (!source) return source.error();
    return loadFrom(*source);
}

} // namespace nacre
