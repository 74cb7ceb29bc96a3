// Runs a fuzz target without libFuzzer: replay_main CORPUS [-runs=N]. Every file of the corpus, then changed copies of
// them up to N executions. The changes depend on nothing but N.
#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "common/file_writing.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

void run(const std::string& bytes) {
    (void)LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

void change(std::string& bytes, std::mt19937& random, const std::vector<std::string>& corpus) {
    const std::size_t at = random() % (bytes.size() + 1);
    switch (random() % 6) {
        case 0: bytes.insert(at, 1, static_cast<char>(random())); break;
        case 1: bytes.erase(at, 1 + random() % 8); break;
        case 2: bytes.insert(at, bytes.substr(random() % (bytes.size() + 1), random() % 64)); break;
        case 3: bytes.resize(at); break;
        case 4: bytes.insert(at, corpus[random() % corpus.size()]); break;
        default:
            if (at < bytes.size()) bytes[at] = static_cast<char>(random());
    }
}

}  // namespace

int main(int argc, char** argv) {
    const std::string option = argc == 3 ? argv[2] : "-runs=10000";
    if (argc < 2 || argc > 3 || !option.starts_with("-runs=")) return 2;
    const long runs = std::atol(option.c_str() + 6);
    std::vector<std::string> corpus;
    for (const auto& entry : std::filesystem::directory_iterator(argv[1]))
        corpus.push_back(hord::common::read_file(entry.path()).value());
    std::ranges::sort(corpus);  // a folder has no order
    if (corpus.empty()) return 2;
    for (const std::string& file : corpus) run(file);
    std::mt19937 random(11);
    for (long k = static_cast<long>(corpus.size()); k < runs; ++k) {
        std::string bytes = corpus[random() % corpus.size()];
        for (auto changes = 1 + random() % 4; changes > 0; --changes) change(bytes, random, corpus);
        if (bytes.size() > 65'536) bytes.resize(65'536);
        run(bytes);
    }
    std::printf("%ld executions, no finding\n", std::max(runs, static_cast<long>(corpus.size())));
    return 0;
}
