// Checkpoint bytes are as hostile as any file. The checksum is repaired after each mutation, so that the parser behind it is reached.
#include "base/hash.h"
#include "train/checkpoint.h"

#include <cstring>
#include <iterator>

static constexpr const char* kModels[] = {"bigs", "sss"};

static nacre::Trainer makeTrainer(const char* model)
{
    nacre::TrainerOptions options;
    options.maxSplats = 40;
    nacre::Trainer trainer(options, nacre::makeTrainableAppearance(model, {4}));
    std::vector<nacre::OrientedPoint> points(20);
    for (size_t i = 0; i < points.size(); ++i) points[i] = {{0.01f * float(i), 0, 0}, {0, 0, 1}};
    trainer.initialize(points, 0.01f, true);
    return trainer;
}

extern "C" size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i)
{
    if (i >= std::size(kModels)) return 0;
    const auto bytes = nacre::encodeCheckpoint("1", {{"a", "b"}}, {}, makeTrainer(kModels[i]));
    if (bytes.size() > cap) return 0;
    std::memcpy(out, bytes.data(), bytes.size());
    return bytes.size();
}

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size)
{
    std::vector<std::byte> bytes(size);
    if (size) std::memcpy(bytes.data(), data, size);
    if (size > 8) {
        const uint64_t sum = nacre::fnv1a(bytes.data(), size - 8);
        std::memcpy(bytes.data() + size - 8, &sum, 8);
    }
    for (const char* model : kModels) {
        nacre::Trainer trainer = makeTrainer(model);
        (void)nacre::decodeCheckpoint(bytes, "1", 2, trainer);
        (void)nacre::skippedImages(bytes);
        (void)nacre::learningGainOf(bytes);
    }
    return 0;
}
