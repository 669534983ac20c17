// Layout: "NCKP", version u32, options hash u64, step i32, seconds f64, trainer state, FNV-1a of all before it.
#include "train/checkpoint.h"

#include "base/file.h"
#include "base/hash.h"

namespace nacre {

constexpr uint32_t kMagic = 0x504b434e, kVersion = 1;

Status writeCheckpoint(const std::string& path, const CheckpointHeader& header, const Trainer& trainer)
{
    ByteWriter out;
    out.value(kMagic), out.value(kVersion), out.value(header.optionsHash), out.value(header.step), out.value(header.seconds);
    trainer.save(out);
    out.value(fnv1a(out.bytes.data(), out.bytes.size()));
    return writeFileAtomically(path, out.bytes);
}

Result<CheckpointHeader> readCheckpoint(const std::string& path, uint64_t optionsHash, Trainer& trainer)
{
    auto bytes = readFile(path);
    if (!bytes) return bytes.error();
    const auto bad = [&](const char* what) { return Error{ErrorCode::kBadInput, path + ": " + what}; };
    if (bytes->size() < 36) return bad("not a checkpoint (too short); start again without --resume");
    const std::span<const std::byte> body(bytes->data(), bytes->size() - sizeof(uint64_t));
    ByteReader tail(std::span<const std::byte>(*bytes).subspan(body.size()));
    if (tail.value<uint64_t>() != fnv1a(body.data(), body.size())) return bad("damaged checkpoint (checksum differs); start again without --resume");
    ByteReader in(body);
    if (in.value<uint32_t>() != kMagic || in.value<uint32_t>() != kVersion) return bad("not a checkpoint of this version; start again without --resume");
    CheckpointHeader header;
    header.optionsHash = in.value<uint64_t>(), header.step = in.value<int32_t>(), header.seconds = in.value<double>();
    if (header.optionsHash != optionsHash) return bad("checkpoint of another bake (dataset or options differ); repeat its options or start again without --resume");
    if (!trainer.load(in) || in.remaining() != 0) return bad("checkpoint does not fit this model; start again without --resume");
    return header;
}

} // namespace nacre
