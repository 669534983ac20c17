// Runs a libFuzzer-style target without libFuzzer: deterministic mutations of seeds, bounded in time and count.
//
//   fuzz_x [--seconds S] [--iterations N] [FILE|FOLDER...]    seeds: the target's own (nacreFuzzSeed) and the given files
//   fuzz_x --write-seeds FOLDER                               the target's own seeds as files, a first corpus for libFuzzer
//
// The input at hand when the target crashes is written to crash-input.bin in the working folder; give it back as FILE to repeat.
#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <unistd.h>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size);
/// Optional: writes seed `i` (from 0) to `out` and returns its size; 0 when there are no more.
extern "C" __attribute__((weak)) size_t nacreFuzzSeed(uint8_t* out, size_t cap, unsigned i);
extern "C" __attribute__((weak)) void __sanitizer_set_death_callback(void (*callback)());

namespace {

using Bytes = std::vector<uint8_t>;
constexpr size_t kMaxSize = size_t(1) << 20;

// What the crash handlers save; plain pointers because a handler may not do more.
const uint8_t* currentData = nullptr;
size_t currentSize = 0;

void saveCurrentInput()
{
    const int fd = ::open("crash-input.bin", O_WRONLY | O_CREAT | O_TRUNC, 0666);
    if (fd < 0) return;
    const ssize_t written = ::write(fd, currentData, currentSize);
    ::close(fd);
    if (written == ssize_t(currentSize)) (void)!::write(2, "input saved to crash-input.bin\n", 31);
}

void onSignal(int signal)
{
    saveCurrentInput();
    std::signal(signal, SIG_DFL);
    std::raise(signal);
}

void run(const Bytes& input)
{
    const Bytes exact(input.begin(), input.end()); // capacity = size, so that a sanitizer sees the first byte too many
    currentData = exact.data();
    currentSize = exact.size();
    LLVMFuzzerTestOneInput(exact.data(), exact.size());
}

using Random = std::mt19937_64;
size_t below(Random& random, size_t n) { return n ? size_t(random() % n) : 0; }

/// One small damage of the kinds that break parsers: flipped bits, extreme integers, cuts, repeats, other digits.
void mutateOnce(Bytes& bytes, const std::vector<Bytes>& seeds, Random& random)
{
    if (bytes.empty()) bytes.push_back(uint8_t(random()));
    const size_t at = below(random, bytes.size());
    const size_t length = std::min(bytes.size() - at, 1 + below(random, below(random, 8) ? 16 : bytes.size()));
    const auto from = bytes.begin() + ptrdiff_t(at);
    switch (random() % 9) {
    case 0:
        bytes[at] ^= uint8_t(1u << (random() % 8));
        break;
    case 1:
        bytes[at] = uint8_t(random());
        break;
    case 2: { // an extreme 32-bit value
        const uint32_t extremes[] = {0, 1, 4, 0x7fffffff, 0x80000000, 0xffffffff, uint32_t(bytes.size()), 0x7fc00000, 0x7f800000};
        const uint32_t value = extremes[below(random, std::size(extremes))] + uint32_t(random() % 3) - 1;
        std::memcpy(&bytes[at], &value, std::min<size_t>(4, bytes.size() - at));
        break;
    }
    case 3:
        bytes.resize(at);
        break;
    case 4:
        bytes.erase(from, from + ptrdiff_t(length));
        break;
    case 5: { // repeat a piece
        const Bytes piece(from, from + ptrdiff_t(length));
        bytes.insert(bytes.begin() + ptrdiff_t(below(random, bytes.size() + 1)), piece.begin(), piece.end());
        break;
    }
    case 6: { // a piece of another seed
        const Bytes& other = seeds[below(random, seeds.size())];
        const size_t start = below(random, other.size());
        const size_t n = std::min({other.size() - start, length, bytes.size() - at});
        std::copy_n(other.begin() + ptrdiff_t(start), n, from);
        break;
    }
    case 7: { // the next number in a text becomes another one
        const auto digit = std::find_if(from, bytes.end(), [](uint8_t c) { return c >= '0' && c <= '9'; });
        const auto end = std::find_if(digit, bytes.end(), [](uint8_t c) { return c < '0' || c > '9'; });
        static const char* const kNumbers[] = {"0",     "-1",  "1",     "2147483648", "4294967295", "18446744073709551615",
                                               "1e308", "0.5", "1e-400"};
        const std::string number = kNumbers[below(random, std::size(kNumbers))];
        const ptrdiff_t where = digit - bytes.begin();
        bytes.erase(digit, end);
        bytes.insert(bytes.begin() + where, number.begin(), number.end());
        break;
    }
    case 8:
        bytes[at] = uint8_t("{}[]\",:\\ 0eE-.tfn"[random() % 17]);
        break;
    }
    if (bytes.size() > kMaxSize) bytes.resize(kMaxSize);
}

Bytes readWhole(const std::filesystem::path& path)
{
    std::ifstream in(path, std::ios::binary);
    return Bytes(std::istreambuf_iterator<char>(in), {});
}

std::vector<Bytes> ownSeeds()
{
    std::vector<Bytes> seeds;
    if (!nacreFuzzSeed) return seeds;
    Bytes buffer(kMaxSize);
    for (unsigned i = 0; const size_t size = nacreFuzzSeed(buffer.data(), buffer.size(), i); ++i)
        seeds.emplace_back(buffer.begin(), buffer.begin() + ptrdiff_t(std::min(size, kMaxSize)));
    return seeds;
}

int writeSeeds(const std::filesystem::path& folder)
{
    std::filesystem::create_directories(folder);
    const std::vector<Bytes> seeds = ownSeeds();
    for (size_t i = 0; i < seeds.size(); ++i) {
        std::ofstream out(folder / ("seed-" + std::to_string(i)), std::ios::binary);
        out.write(reinterpret_cast<const char*>(seeds[i].data()), std::streamsize(seeds[i].size()));
        if (!out.flush()) return 1;
    }
    std::printf("%zu seeds\n", seeds.size());
    return 0;
}

} // namespace

int main(int argc, char** argv)
{
    double seconds = 3;
    uint64_t iterations = ~uint64_t(0);
    std::vector<Bytes> seeds = ownSeeds();
    for (int i = 1; i < argc; ++i) {
        const std::string option = argv[i];
        const bool hasValue = i + 1 < argc;
        if (option == "--seconds" && hasValue)
            seconds = std::atof(argv[++i]);
        else if (option == "--iterations" && hasValue)
            iterations = std::strtoull(argv[++i], nullptr, 10);
        else if (option == "--write-seeds" && hasValue)
            return writeSeeds(argv[++i]);
        else if (std::filesystem::is_directory(option)) {
            std::vector<std::filesystem::path> paths;
            for (const auto& entry : std::filesystem::directory_iterator(option))
                if (entry.is_regular_file()) paths.push_back(entry.path());
            std::sort(paths.begin(), paths.end()); // folder order differs between machines
            for (const auto& path : paths) seeds.push_back(readWhole(path));
        } else if (std::filesystem::is_regular_file(option))
            seeds.push_back(readWhole(option));
        else {
            std::fprintf(stderr, "%s: neither an option nor a file\n", option.c_str());
            return 2;
        }
    }
    if (seeds.empty()) seeds.emplace_back();

    for (int signal : {SIGSEGV, SIGABRT, SIGFPE, SIGBUS, SIGILL, SIGALRM}) std::signal(signal, onSignal);
    if (__sanitizer_set_death_callback) __sanitizer_set_death_callback(saveCurrentInput);

    const auto start = std::chrono::steady_clock::now();
    const auto elapsed = [&] { return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count(); };
    for (const Bytes& seed : seeds) run(seed);
    Random random(1);
    uint64_t done = 0;
    for (; done < iterations && elapsed() < seconds; ++done) {
        Bytes input = seeds[below(random, seeds.size())];
        for (size_t n = 1 + below(random, 1 + below(random, 8)); n > 0; --n) mutateOnce(input, seeds, random);
        ::alarm(30); // an input that hangs is a crash too
        run(input);
        ::alarm(0);
    }
    std::printf("%zu seeds, %llu mutated inputs, %.1f s: no crash\n", seeds.size(), static_cast<unsigned long long>(done),
                elapsed());
    return 0;
}
