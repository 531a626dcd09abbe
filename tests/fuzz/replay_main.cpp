#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

// What drives a fuzz target where there is no libFuzzer: every seed as it is, then repeatable
// mutations. It explores little; it keeps the targets compiling and the obvious damage covered.
namespace {

using Bytes = std::vector<std::uint8_t>;

// Enough to touch every header field of a small seed, few enough for a second's run.
constexpr int kMutationsPerSeed = 400;

std::vector<Bytes> read_seeds(int argc, char** argv) {
  std::vector<Bytes> seeds = {Bytes{}};
  for (int i = 1; i < argc; ++i) {
    std::vector<std::filesystem::path> paths;
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      if (entry.is_regular_file()) paths.push_back(entry.path());
    }
    std::sort(paths.begin(), paths.end());  // a folder's order is not repeatable
    for (const auto& path : paths) {
      std::ifstream in(path, std::ios::binary);
      seeds.emplace_back(std::istreambuf_iterator<char>(in), std::istreambuf_iterator<char>());
    }
  }
  return seeds;
}

std::size_t below(std::mt19937& random, std::size_t bound) {
  return random() % bound;  // the same on every standard library, unlike its distributions
}

Bytes mutate(Bytes bytes, std::mt19937& random) {
  if (bytes.empty()) bytes.resize(1 + below(random, 64));
  const std::size_t edits = 1 + below(random, 4);
  for (std::size_t i = 0; i < edits && !bytes.empty(); ++i) {
    const std::size_t at = below(random, bytes.size());
    const auto here = bytes.begin() + static_cast<std::ptrdiff_t>(at);
    switch (below(random, 5)) {
      case 0:
        *here = static_cast<std::uint8_t>(random());
        break;
      case 1:
        *here = static_cast<std::uint8_t>(*here ^ (1U << below(random, 8)));
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3:
        bytes.insert(here, static_cast<std::uint8_t>(random()));
        break;
      default:
        bytes.erase(here);
        break;
    }
  }
  return bytes;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<Bytes> seeds = read_seeds(argc, argv);
  std::mt19937 random(20);
  std::size_t runs = 0;
  for (const Bytes& seed : seeds) {
    LLVMFuzzerTestOneInput(seed.data(), seed.size());
    for (int i = 0; i < kMutationsPerSeed; ++i) {
      const Bytes changed = mutate(seed, random);
      LLVMFuzzerTestOneInput(changed.data(), changed.size());
    }
    runs += 1 + kMutationsPerSeed;
  }
  std::printf("%zu seeds, %zu inputs\n", seeds.size() - 1, runs);
  return 0;
}
