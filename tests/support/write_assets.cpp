// Writes one small asset of each model, FOLDER/bigs.glb and FOLDER/sss.glb, for tests that look at programs from outside.
#include "formats_fixtures.h"

#include <cstdio>

int main(int argc, char** argv)
{
    using namespace nacre;
    if (argc != 2) return 2;
    const std::string folder = argv[1];
    for (const SplatAsset& asset : {test::makeAsset(40, 4, 4), test::makeSss(40, /*all*/ true)})
        if (const Status s = writeAsset(asset, folder + "/" + asset.model + ".glb"); !s) {
            std::fprintf(stderr, "write_assets: %s\n", s.error().message.c_str());
            return 1;
        }
    return 0;
}
