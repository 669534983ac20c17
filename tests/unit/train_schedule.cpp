// How long a bake is and when it adds splats, for few images and for many.
#include "train/schedule.h"

#include <doctest/doctest.h>

using namespace nacre;

namespace {

OlatDataset dataset(int cameras, int lightsPerCamera)
{
    OlatDataset out;
    OlatSplit& train = out.splits.emplace_back();
    train.name = "train";
    train.cameras.resize(size_t(cameras));
    for (int c = 0; c < cameras; ++c)
        for (int l = 0; l < lightsPerCamera; ++l) train.images.push_back({uint32_t(c), {}, ""});
    return out;
}

BakeOptions minutes(double m)
{
    BakeOptions options;
    options.minutes = m;
    return options;
}

/// How far a bake by steps that begins with 1000 splats lets their number grow.
double growth(int iterations, int cameras)
{
    BakeOptions options;
    options.iterations = iterations;
    const OlatDataset data = dataset(cameras, 1);
    Schedule schedule(options, data);
    schedule.beginTraining(0, size_t(cameras));
    double splats = 1000;
    for (int step = 1, since = 1; step <= iterations; ++step, ++since)
        if (schedule.densifies(since, schedule.progress(step))) splats += double(schedule.growth(size_t(splats))), since = 0;
    return splats / 1000;
}

} // namespace

TEST_CASE("a bake in minutes may see each image as often as those that its quality was tuned on, however many there are")
{
    CHECK(bakeIterations(minutes(10), dataset(75, 4)) == 10000);
    CHECK(bakeIterations(minutes(10), dataset(25, 4)) == 10000); // never fewer
    CHECK(bakeIterations(minutes(10), dataset(750, 4)) == 100000);
    CHECK(bakeIterations(minutes(10), dataset(300, 1)) == 40000); // a step shows one image, not four
    CHECK(bakeIterations(minutes(10), dataset(75, 16)) == 40000);
    CHECK(bakeIterations({}, dataset(750, 4)) == 10000); // without minutes the quality says how long it takes,
    CHECK(bakeIterations({}, dataset(2000, 1)) == 40000); // as many images shown,
    CHECK(bakeIterations({}, dataset(100, 112)) == 14000); // and each of them five times
    BakeOptions given;
    given.iterations = 123;
    CHECK(bakeIterations(given, dataset(750, 4)) == 123);
    for (const OlatDataset& data : {dataset(75, 4), dataset(750, 4), dataset(300, 1)})
        CHECK(saturation(bakeIterations(minutes(10), data), minutes(10), data) == doctest::Approx(1));
    CHECK(saturation(10000, {}, dataset(750, 4)) == doctest::Approx(0.1));
}

TEST_CASE("thousands of views add splats as quickly as a hundred")
{
    const double few = growth(10000, 75);
    CHECK(few > 10); // up to the cap, in a bake
    CHECK(growth(10000, 2000) == doctest::Approx(few).epsilon(0.15)); // the last densification may fall on either side of the end
    CHECK(growth(10000, 20000) == growth(10000, 2000));
}

TEST_CASE("time that is no work of the bake does not bring its end nearer")
{
    Schedule schedule(minutes(1), dataset(75, 4));
    schedule.beginTraining(0, 75);
    const double before = schedule.progress(0);
    schedule.leaveOut(-30);
    CHECK(schedule.progress(0) == doctest::Approx(before + 30 / (0.99 * 60)).epsilon(0.02));
    schedule.leaveOut(30);
    CHECK(schedule.progress(0) == doctest::Approx(before).epsilon(0.02));
}
