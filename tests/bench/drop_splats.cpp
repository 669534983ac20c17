// drop_splats IN.glb OUT.glb SHARE [SEED]: an asset of so many of the splats, chosen uniformly at random and otherwise as they were: what an order
// of importance has to beat. Profile lossless.
#include "asset/asset_io.h"
#include "splats/reorder.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <numeric>
#include <random>

using namespace nacre;

int main(int argc, char** argv)
{
    const double share = argc > 3 ? std::atof(argv[3]) : 0;
    if (!(share > 0 && share <= 1)) return std::fprintf(stderr, "usage: drop_splats IN.glb OUT.glb SHARE [SEED]\n"), 2;
    auto asset = readAsset(argv[1]);
    if (!asset) return std::fprintf(stderr, "%s\n", asset.error().message.c_str()), 2;
    std::vector<uint32_t> order(asset->cloud.count);
    std::iota(order.begin(), order.end(), 0u);
    std::shuffle(order.begin(), order.end(), std::mt19937(argc > 4 ? unsigned(std::atoi(argv[4])) : 1u));
    order.resize(std::max<size_t>(1, size_t(share * double(order.size()))));
    std::sort(order.begin(), order.end());
    std::erase_if(asset->channels, [](const Channel& c) { return c.name == "importance" || c.name == "growth"; });
    reorderSplats(*asset, order);
    if (const Status s = writeAsset(*asset, argv[2]); !s) return std::fprintf(stderr, "%s\n", s.error().message.c_str()), 1;
}
