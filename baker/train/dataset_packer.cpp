// Images are taken in chunks that fit the memory: decoded and encoded on all threads, laid out one after the other, written on all threads, and then
// noted in a journal, which is what a run that was interrupted goes on from. Layout and bytes do not depend on the number of threads.
#include "train/dataset_packer.h"

#include "base/byte_stream.h"
#include "base/file.h"
#include "base/hash.h"
#include "base/text.h"

#include <tbb/parallel_for.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <map>
#include <sys/file.h>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>

namespace nacre {
namespace {

namespace fs = std::filesystem;

constexpr uint32_t kMagic = 0x4a50434e, kVersion = 1; // "NCPJ"
constexpr uint64_t kReserve = uint64_t(1) << 30;      // of the free disk, left to others
constexpr size_t kSamples = 24;                       // images that tell how much disk all need
constexpr double kSlack = 1.05;                       // of that estimate
constexpr size_t kMostAtOnce = 64;                    // images between two looks at the clock

double clockSeconds() { return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count(); }

Error ioError(const std::string& path, const std::string& what)
{
    const int error = errno;
    return {ErrorCode::kIo, "cannot " + what + " '" + path + "': " + std::generic_category().message(error) +
                                (error == ENOSPC || error == EDQUOT || error == EFBIG ? "; free some space and give the same command again" : "")};
}

/// Two digits or more, whatever the size.
std::string sizeText(double bytes)
{
    char text[32];
    const double unit = bytes < 1e5 ? 1e3 : bytes < 1e8 ? 1e6 : 1e9;
    std::snprintf(text, sizeof text, bytes < 10 * unit ? "%.2g %s" : "%.0f %s", bytes / unit, unit == 1e3 ? "kB" : unit == 1e6 ? "MB" : "GB");
    return text;
}

/// A file that is written at many places at once.
struct OpenFile {
    int fd = -1;
    std::string path;
    ~OpenFile()
    {
        if (fd >= 0) ::close(fd);
    }
    Status open(const std::string& name)
    {
        path = name;
        fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666);
        return fd >= 0 ? ok() : Status(ioError(path, "open"));
    }
    bool write(std::span<const std::byte> bytes, uint64_t at) const
    {
        while (!bytes.empty()) {
            const ssize_t n = ::pwrite(fd, bytes.data(), bytes.size(), off_t(at));
            if (n < 0 && errno == EINTR) continue;
            if (n == 0) errno = ENOSPC;
            if (n <= 0) return false;
            bytes = bytes.subspan(size_t(n)), at += uint64_t(n);
        }
        return true;
    }
    bool read(std::span<std::byte> bytes, uint64_t at) const
    {
        while (!bytes.empty()) {
            const ssize_t n = ::pread(fd, bytes.data(), bytes.size(), off_t(at));
            if (n < 0 && errno == EINTR) continue;
            if (n <= 0) return false;
            bytes = bytes.subspan(size_t(n)), at += uint64_t(n);
        }
        return true;
    }
};

/// What became of one image.
struct Record {
    uint64_t stamp = 0;  // of its files; 0: not looked at yet
    PackedBlock block;
    std::string fault;   // why it is left out; then the block is none
};

struct Item {
    const OlatSplit* split;
    size_t index;
    const OlatImage& image() const { return split->images[index]; }
};

/// Changes with the file.
uint64_t stampOf(const std::string& path, uint64_t hash)
{
    struct stat info = {};
    if (path.empty() || ::stat(path.c_str(), &info) != 0) return fnv1a("none", 4, hash);
    const int64_t parts[] = {int64_t(info.st_size), int64_t(info.st_mtim.tv_sec), int64_t(info.st_mtim.tv_nsec)};
    return fnv1a(parts, sizeof parts, hash);
}

uint64_t stampOf(const OlatImage& image)
{
    uint64_t hash = kFnvOffset;
    for (const std::string* path : {&image.path, &image.maskPath, &image.ambientPath, &image.light.environmentPath}) hash = stampOf(*path, hash);
    return hash | 1u; // never 0
}

/// Of everything but the files' contents. What the dataset says of how files are read, too: it changes pixels.
uint64_t identityOf(const OlatDataset& dataset)
{
    uint64_t hash = kFnvOffset;
    const auto add = [&](const auto&... x) { ((hash = fnv1a(&x, sizeof x, hash)), ...); };
    const auto addText = [&](const std::string& text) { hash = fnv1a(text.c_str(), text.size() + 1, hash); };
    addText(dataset.convention);
    add(dataset.colorSpace, dataset.colorSpaceIsGuess, dataset.premultiplied, dataset.straightPng, dataset.blackLevel, dataset.whiteLevel);
    for (const OlatSplit& split : dataset.splits) {
        addText(split.name);
        for (const Camera& c : split.cameras) add(c.width, c.height, c.fx, c.fy, c.cx, c.cy, c.worldFromCamera);
        for (const FileCamera& f : split.files) add(f.width, f.height, f.fx, f.fy, f.cx, f.cy, f.k, f.p);
        for (const OlatImage& image : split.images) {
            addText(image.path), addText(image.maskPath), addText(image.ambientPath), addText(image.light.environmentPath);
            add(image.camera, image.gain, image.light.type, image.light.position, image.light.directionToLight, image.light.intensity);
        }
    }
    return hash;
}

bool isEightBit(const std::string& path)
{
    constexpr size_t kDepthAt = 24; // in a PNG
    const auto start = readFileStart(path, kDepthAt + 1);
    if (!start || start->bytes.size() <= kDepthAt) return false;
    if (std::memcmp(start->bytes.data(), "\x89PNG", 4) == 0) return std::to_integer<int>(start->bytes[kDepthAt]) <= 8;
    return std::memcmp(start->bytes.data(), "\xff\xd8\xff", 3) == 0; // JPEG
}

class Packer {
public:
    Packer(const OlatDataset& dataset, const PackerOptions& options, const std::function<void(size_t, size_t, double)>& progress, const std::atomic<bool>* cancel)
        : dataset_(dataset), options_(options), progress_(progress), cancel_(cancel), folder_(options.output + ".part"), bytesOnly_(options.pixels == PackerOptions::Pixels::kBytes)
    {
        for (const OlatSplit& split : dataset.splits) {
            faults_.try_emplace(&split, split);
            for (size_t i = 0; i < split.images.size(); ++i) items_.push_back({&split, i});
            for (const Camera& camera : split.cameras)
                mostPixels_ = std::max(mostPixels_, size_t(camera.width) * size_t(camera.height));
        }
        records_.resize(items_.size());
    }
    Result<PackerReport> run();

private:
    Status openFiles();
    Status takeOver(std::span<const std::byte> journal);
    Status measure();
    Status packAll();
    Status packChunk(const std::vector<size_t>& chunk);
    std::vector<std::byte> packOne(size_t item, ImageCache& files);
    Status copyMaps(OlatDataset& packed);
    Result<PackerReport> finish();
    Status tick(size_t done);
    Error cancelled() const { return {ErrorCode::kCancelled, "stopped; '" + folder_ + "' keeps what is done: give the same command again to go on"}; }
    bool halvesFor(const OlatImage& image) const { return !bytesOnly_ && (options_.pixels == PackerOptions::Pixels::kHalves || !isEightBit(image.path)); }

    const OlatDataset& dataset_;
    const PackerOptions& options_;
    const std::function<void(size_t, size_t, double)>& progress_;
    const std::atomic<bool>* cancel_;
    std::string folder_;
    bool bytesOnly_;
    size_t mostPixels_ = 1;
    std::map<const OlatSplit*, ImageFaults> faults_;
    std::vector<Item> items_;
    std::vector<Record> records_;
    OpenFile pixels_, journal_;
    uint64_t end_ = 0, journalEnd_ = 0, available_ = 0;
    size_t reused_ = 0, done_ = 0;
    double started_ = 0;
    std::vector<std::string> notes_;
};

Status Packer::tick(size_t done)
{
    if (cancel_ && cancel_->load()) return cancelled();
    const size_t fresh = done - std::min(done, reused_);
    if (progress_) progress_(done, items_.size(), fresh ? (clockSeconds() - started_) / double(fresh) * double(items_.size() - done) : -1.0);
    return ok();
}

/// The records of an earlier run whose files and pixels are as they were.
Status Packer::takeOver(std::span<const std::byte> journal)
{
    ByteReader in(journal);
    if (in.value<uint32_t>() != kMagic || in.value<uint32_t>() != kVersion || in.value<PackerOptions::Pixels>() != options_.pixels || in.value<uint64_t>() != identityOf(dataset_)) return ok();
    struct stat info = {};
    const uint64_t pixelBytes = ::fstat(pixels_.fd, &info) == 0 ? uint64_t(info.st_size) : 0;
    std::vector<size_t> found;
    for (journalEnd_ = journal.size() - in.remaining(); in.remaining() > 0; journalEnd_ = journal.size() - in.remaining()) {
        std::vector<std::byte> body;
        in.array(body);
        if (in.value<uint64_t>() != fnv1a(body.data(), body.size()) || in.failed) break; // cut off while it was written
        ByteReader record(body);
        const uint64_t item = record.value<uint64_t>();
        Record r;
        r.stamp = record.value<uint64_t>(), r.block = record.value<PackedBlock>();
        record.array(r.fault);
        const PackedBlock& b = r.block;
        if (record.failed || item >= items_.size()) break;
        if (r.stamp != stampOf(items_[item].image())) continue;
        if (r.fault.empty()) {
            const Camera& c = items_[item].split->cameras[items_[item].image().camera];
            if (b.width != c.width || b.height != c.height || b.x < 0 || b.y < 0 || b.columns < 0 || b.rows < 0 || b.columns > b.width - b.x || b.rows > b.height - b.y ||
                b.offset > pixelBytes || b.bytes() > pixelBytes - b.offset)
                continue;
        }
        records_[item] = std::move(r), found.push_back(item);
    }
    for (size_t first = 0; first < found.size(); first += kMostAtOnce) {
        if (Status s = tick(first); !s) return s;
        tbb::parallel_for(first, std::min(first + kMostAtOnce, found.size()), [&](size_t k) {
            Record& r = records_[found[k]];
            if (!r.fault.empty() || r.stamp == 0) return;
            std::vector<std::byte> bytes(r.block.bytes());
            if (!pixels_.read(bytes, r.block.offset) || hashOfPixels(bytes) != r.block.hash) r = {};
        });
    }
    for (const Record& r : records_)
        if (r.stamp) ++reused_, end_ = std::max(end_, r.fault.empty() ? r.block.offset + r.block.bytes() : 0);
    return ok();
}

Status Packer::openFiles()
{
    if (Status s = checkPackedOutput(options_.output); !s) return s;
    std::error_code error;
    fs::create_directories(folder_, error);
    if (error)
        return Error{error == std::errc::no_space_on_device ? ErrorCode::kIo : ErrorCode::kBadInput, "cannot create folder '" + folder_ + "': " + error.message() + "; give a name elsewhere"};
    const auto inFolder = [&](const char* name) { return (fs::path(folder_) / name).string(); };
    if (Status s = pixels_.open(inFolder(kPackedPixels)); !s) return s;
    if (::flock(pixels_.fd, LOCK_EX | LOCK_NB) != 0) return Error{ErrorCode::kIo, "another process is writing '" + folder_ + "'"};
    if (Status s = journal_.open(inFolder(kPackedJournal)); !s) return s;
    const auto journal = readFile(journal_.path);
    if (!journal) return journal.error();
    if (Status s = takeOver(*journal); !s) return s;
    if (reused_ == 0) {
        ByteWriter header;
        header.value(kMagic), header.value(kVersion), header.value(options_.pixels), header.value(identityOf(dataset_));
        if (!journal_.write(header.bytes, 0)) return ioError(journal_.path, "write");
        journalEnd_ = header.bytes.size();
    }
    if (::ftruncate(journal_.fd, off_t(journalEnd_)) != 0 || ::ftruncate(pixels_.fd, off_t(end_)) != 0) return ioError(pixels_.path, "write");

    const fs::space_info space = fs::space(folder_, error);
    const uint64_t free = error ? UINT64_MAX / 2 : uint64_t(space.available) > kReserve ? uint64_t(space.available) - kReserve : 0;
    available_ = end_ + free;
    if (options_.diskBytes > 0) available_ = std::min(available_, options_.diskBytes);
    return ok();
}

/// The bytes of an image, its record filled in; none if it is left out.
std::vector<std::byte> Packer::packOne(size_t item, ImageCache& files)
{
    const OlatImage& entry = items_[item].image();
    Record& record = records_[item];
    record.stamp = stampOf(entry);
    const auto image = files.load(*items_[item].split, items_[item].index);
    record.fault = image ? faults_.at(items_[item].split).of(entry, **image) : image.error().message;
    if (record.fault.empty() && entry.light.type == LightType::kEnvironment)
        if (const auto map = readFileStart(entry.light.environmentPath, 4); !map) record.fault = entry.path + ": its environment map cannot be used: " + map.error().message;
    if (!record.fault.empty()) return {};
    return encodePixels(**image, halvesFor(entry), record.block);
}

/// How much disk all will need, by some of them; and whether halves fit.
Status Packer::measure()
{
    std::vector<size_t> open;
    for (size_t i = 0; i < items_.size(); ++i)
        if (records_[i].stamp == 0) open.push_back(i);
    if (double(end_) + 8.0 * double(mostPixels_) * double(open.size()) <= double(available_)) return ok();
    const size_t count = std::min(open.size(), kSamples);
    std::vector<double> chosen(count), bytes(count);
    ImageCache files(dataset_, 0);
    tbb::parallel_for(size_t(0), count, [&](size_t k) {
        const Item& item = items_[open[k * open.size() / count]];
        const auto image = files.load(*item.split, item.index);
        if (!image) return;
        PackedBlock block;
        (void)encodePixels(**image, false, block);
        bytes[k] = double(block.bytes()), chosen[k] = bytes[k] * (halvesFor(item.image()) ? 2 : 1);
    });
    double needed = double(end_), least = double(end_);
    const double scale = count ? kSlack * double(open.size()) / double(count) : 0;
    for (size_t k = 0; k < count; ++k) needed += scale * chosen[k], least += scale * bytes[k];
    if (needed <= double(available_)) return ok();
    const auto tooLarge = [&](double need) {
        return Error{options_.diskBytes > 0 && available_ == options_.diskBytes ? ErrorCode::kBadInput : ErrorCode::kIo,
                     "'" + options_.output + "' needs about " + sizeText(need) + " of disk" + (least < need ? " (" + sizeText(least) + " with --format bytes)" : "") + ", there are " +
                         sizeText(double(available_)) + (options_.diskBytes > 0 ? " (--disk)" : " free")};
    };
    if (options_.pixels != PackerOptions::Pixels::kAuto) return tooLarge(needed);
    if (least > double(available_)) return tooLarge(least);
    bytesOnly_ = true;
    notes_.push_back("there is no disk for halves (" + sizeText(needed) + "): all images are stored as bytes, values above 1 are cut off");
    return ok();
}

Status Packer::packChunk(const std::vector<size_t>& chunk)
{
    std::vector<std::vector<std::byte>> bytes(chunk.size());
    ImageCache files(dataset_, 0); // each is needed once
    tbb::parallel_for(size_t(0), chunk.size(), [&](size_t k) { bytes[k] = packOne(chunk[k], files); }, tbb::simple_partitioner());
    for (std::string& note : files.notes())
        if (std::find(notes_.begin(), notes_.end(), note) == notes_.end()) notes_.push_back(std::move(note));
    for (const size_t item : chunk) {
        Record& r = records_[item];
        if (!r.fault.empty()) continue;
        r.block.offset = end_, end_ += r.block.bytes();
    }
    if (end_ > available_)
        return Error{ErrorCode::kIo, "'" + options_.output + "' needs more than the " + sizeText(double(available_)) + " of disk that there are; '" + folder_ + "' keeps what is done"};
    std::atomic<int> failed{0};
    tbb::parallel_for(size_t(0), chunk.size(), [&](size_t k) {
        if (!pixels_.write(bytes[k], records_[chunk[k]].block.offset)) failed = errno;
    });
    errno = failed;
    if (errno) return ioError(pixels_.path, "write");

    ByteWriter journal;
    for (const size_t item : chunk) {
        const Record& r = records_[item];
        ByteWriter record;
        record.value(uint64_t(item)), record.value(r.stamp), record.value(r.block), record.array(r.fault);
        journal.array(record.bytes), journal.value(fnv1a(record.bytes.data(), record.bytes.size()));
    }
    if (!journal_.write(journal.bytes, journalEnd_)) return ioError(journal_.path, "write");
    journalEnd_ += journal.bytes.size();
    return ok();
}

Status Packer::packAll()
{
    const size_t perImage = mostPixels_ * 8; // as halves; each thread decodes in 32 bytes a pixel or more
    const size_t atOnce = std::clamp<size_t>(options_.memoryBytes / (4 * perImage), 1, kMostAtOnce);
    done_ = reused_;
    std::vector<size_t> chunk;
    for (size_t i = 0; i < items_.size(); ++i) {
        if (records_[i].stamp == 0) chunk.push_back(i);
        if (chunk.empty() || (chunk.size() < atOnce && i + 1 < items_.size())) continue;
        if (Status s = tick(done_); !s) return s;
        if (Status s = packChunk(chunk); !s) return s;
        done_ += chunk.size();
        chunk.clear();
    }
    return ok();
}

Status Packer::copyMaps(OlatDataset& packed)
{
    std::map<std::string, std::string> copies;
    for (OlatSplit& split : packed.splits)
        for (OlatImage& image : split.images) {
            std::string& path = image.light.environmentPath;
            if (path.empty()) continue;
            const auto [copy, isNew] = copies.try_emplace(path, "maps/" + std::to_string(copies.size()) + fs::path(path).extension().string());
            if (isNew) {
                const auto bytes = readFile(path);
                if (!bytes) return bytes.error();
                std::error_code error;
                fs::create_directories(fs::path(folder_) / "maps", error);
                if (Status s = writeFileAtomically((fs::path(folder_) / copy->second).string(), *bytes); !s) return s;
            }
            path = copy->second;
        }
    return ok();
}

Result<PackerReport> Packer::finish()
{
    PackerReport report;
    report.decodeSeconds = clockSeconds() - started_;
    PackedImages images; // their descriptions
    OlatDataset packed = dataset_; // its images are developed
    std::vector<UnusableImage> faults;
    size_t item = 0;
    for (OlatSplit& split : packed.splits) {
        std::vector<OlatImage> kept;
        const size_t count = split.images.size();
        faults.clear();
        for (OlatImage& image : split.images) {
            const Record& r = records_[item++];
            if (!r.fault.empty()) {
                faults.push_back({image.path, r.fault});
                images.skipped.push_back({split.name, image.path, r.fault});
                continue;
            }
            report.halves += r.block.halves;
            image.packedBlock = uint32_t(images.blocks.size());
            images.blocks.push_back(r.block);
            kept.push_back(std::move(image));
        }
        split.images = std::move(kept);
        if (split.name == "train")
            if (Status s = fewUnusable(faults, count, split.name); !s) return s.error();
        if (split.images.empty()) notes_.push_back("no image of split '" + split.name + "' can be used: it is left out");
    }
    std::erase_if(packed.splits, [](const OlatSplit& split) { return split.images.empty(); });
    if (packed.splits.empty()) return Error{ErrorCode::kBadInput, dataset_.path + ": no image can be used, the first: " + images.skipped[0].why};
    if (options_.strict && !images.skipped.empty())
        return Error{ErrorCode::kBadInput, "--strict: " + std::to_string(images.skipped.size()) + " images cannot be used, the first: " + images.skipped[0].why +
                                               "; mend or leave out those and give the same command again ('" + folder_ + "' keeps the others)"};
    if (Status s = copyMaps(packed); !s) return s.error();
    std::string list;
    for (const SkippedImage& s : images.skipped) list += s.split + "\t" + s.path + "\t" + oneLine(s.why) + "\n";
    if (Status s = writeFileAtomically((fs::path(folder_) / "skipped.txt").string(), std::as_bytes(std::span(list))); !s) return s.error();
    if (::fsync(pixels_.fd) != 0) return ioError(pixels_.path, "write");
    images.sourceState = sourceState(dataset_);
    const std::string description = encodePackedDescription(packed, images);
    if (Status s = writeFileAtomically((fs::path(folder_) / kPackedDescription).string(), std::as_bytes(std::span(description))); !s) return s.error();
    std::error_code error;
    fs::remove(journal_.path, error);
    fs::rename(folder_, options_.output, error);
    if (error) return Error{ErrorCode::kIo, "cannot rename '" + folder_ + "' to '" + options_.output + "': " + error.message()};
    report.images = images.blocks.size(), report.reused = reused_, report.bytes = end_;
    report.skipped = std::move(images.skipped), report.notes = std::move(notes_);
    return report;
}

Result<PackerReport> Packer::run()
{
    started_ = clockSeconds();
    if (Status s = openFiles(); !s) return s.error();
    started_ = clockSeconds();
    if (Status s = measure(); !s) {
        std::error_code ignored;
        if (end_ == 0) fs::remove_all(folder_, ignored); // nothing to go on with
        return s.error();
    }
    if (Status s = packAll(); !s) return s.error();
    return finish();
}

} // namespace

Status checkPackedOutput(const std::string& output)
{
    std::error_code error;
    if (output.empty()) return Error{ErrorCode::kBadInput, "the prepared dataset has no name; name a folder to make"};
    if (fs::exists(fs::symlink_status(output, error))) return Error{ErrorCode::kBadInput, "'" + output + "' is there already; remove it or give another name"};
    fs::path folder = fs::exists(output + ".part", error) ? fs::path(output + ".part") : fs::absolute(output, error).parent_path();
    while (folder.has_relative_path() && !fs::exists(folder, error)) folder = folder.parent_path(); // the rest is made
    const bool isFolder = fs::is_directory(folder, error);
    if (isFolder && ::access(folder.c_str(), W_OK | X_OK) == 0) return ok();
    return Error{ErrorCode::kBadInput, "cannot make '" + output + "': " + (isFolder ? "nothing can be written into '" + folder.string() + "' (" + std::generic_category().message(errno) + ")"
                                                                                    : "'" + folder.string() + "' is no folder") + "; give a name elsewhere"};
}

uint64_t sourceState(const OlatDataset& dataset)
{
    uint64_t hash = identityOf(dataset);
    for (const OlatSplit& split : dataset.splits)
        for (const OlatImage& image : split.images) {
            const uint64_t stamp = stampOf(image);
            hash = fnv1a(&stamp, sizeof stamp, hash);
        }
    return hash;
}

Result<PackerReport> packDataset(const OlatDataset& dataset, const PackerOptions& options, const std::function<void(size_t, size_t, double)>& progress,
                                 const std::atomic<bool>* cancel)
{
    return Packer(dataset, options, progress, cancel).run();
}

} // namespace nacre
