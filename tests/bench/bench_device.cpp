// Whole bakes of a dataset by the CPU's engine and by the engine of CUDA cards, on a card or emulated: held-out PSNR of both, and the time of a step.
//   bench_device DATASET [MODEL] [STEPS] [cuda | emulated] [max splats]
#include "dataset/olat_dataset.h"
#include "device/cuda_engine.h"
#include "device/engine.h"
#include "train/bake.h"

#include <cstdio>
#include <cstdlib>
#include <string>

using namespace nacre;

static MakeStepEngine emulatedEngine()
{
    return [](SplatState& state, const StepOptions& options) -> std::unique_ptr<StepEngine> {
        auto engine = std::make_unique<emulated::DeviceEngine>(std::make_unique<emulated::Device>(), state, options);
        state.appearance->setVisibilityDrawer({}); // by the CPU: thousands of views take the emulator minutes
        return engine;
    };
}

int main(int argc, char** argv)
{
    const auto argument = [&](int i, const char* fallback) { return std::string(argc > i ? argv[i] : fallback); };
    const auto fail = [](const std::string& why) {
        std::fprintf(stderr, "bench_device: %s\n", why.c_str());
        return 1;
    };
    if (argc < 2) return fail("expected DATASET [MODEL] [STEPS] [cuda | emulated] [max splats]");
    const auto dataset = loadDataset(argv[1]);
    if (!dataset) return fail(dataset.error().message);
    BakeOptions options;
    options.model = argument(2, "bigs"), options.iterations = std::atoi(argument(3, "200").c_str()), options.maxSplats = std::atoi(argument(5, "0").c_str());
    options.track = BakeOptions::Track::kAtEnd;
    MakeStepEngine engine = emulatedEngine();
    if (argument(4, "cuda") == "cuda") {
        auto cuda = cudaEngine();
        if (!cuda) return fail(cuda.error().message);
        std::printf("%s\n", cuda->card.c_str());
        engine = cuda->make;
    }
    double decibel[2] = {};
    for (const bool device : {false, true}) {
        options.makeEngine = device ? engine : makeCpuEngine;
        const auto result = bake(*dataset, options, {}, nullptr);
        if (!result) return fail(result.error().message);
        if (result->history.empty()) return fail("the dataset has no test split to judge by");
        const HistoryPoint& end = result->history.back();
        decibel[device] = end.psnrMaskedTest;
        std::printf("%-6s %s, %d steps in %.1f s (%.2f ms a step, all in), %zu splats, train %.3f dB, held out %.3f dB, masked %.3f dB\n", device ? "device" : "cpu",
                    options.model.c_str(), result->iterations, result->seconds, 1e3 * result->seconds / result->iterations, result->asset.cloud.count,
                    result->psnrTrain, end.psnrTest, end.psnrMaskedTest);
        std::fflush(stdout);
    }
    std::printf("difference %.3f dB\n", decibel[1] - decibel[0]);
    return std::abs(decibel[1] - decibel[0]) < 0.1 ? 0 : 1;
}
