// The readers of a user's files that the program links, given any bytes: each ends in a value or in one message of
// ours, on printable lines. As libFuzzer: `PROGRAM READER [options] FOLDER`. Else `PROGRAM READER COUNT SEED FILE..`
// reads these files, then COUNT inputs made of them; `PROGRAM special` gives what is no such file to every reader;
// `PROGRAM` alone prints their names.
#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <functional>
#include <random>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>
#include <yaml-cpp/exceptions.h>

#include <tribotwin/plugins/mujoco/callbacks.hpp>
#include <tribotwin/tests/fuzz/reader.hpp>
#include <tribotwin/twin/io/file.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace {

using namespace tribotwin;
using namespace tribotwin::twin;
using namespace tribotwin::fuzz;

const Reader* chosen = nullptr;

const Reader* find(std::string_view name) {
  const auto found = std::ranges::find(readers(), name, &Reader::name);
  return found == readers().end() ? nullptr : &*found;
}

/// Where inputs lie: beside models and recordings that they name, as in the source tree.
const Path& folder() {
  static const TemporaryFolder root("tribotwin-fuzz");
  static const Path inputs = [] {
    const Path below = root.path() / "twin/scenarios", source = TRIBOTWIN_SOURCE_DIR;
    std::filesystem::create_directories(below);
    std::filesystem::create_directory_symlink(source / "mjcf", root.path() / "mjcf");
    std::filesystem::create_directory_symlink(source / "tests/fuzz/corpus/bam", below / "bam");
    std::filesystem::create_symlink(source / "mjcf/scene.xml", below / "scene.xml");
    return below;
  }();
  return inputs;
}

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* argc, char*** argv) {
  // In memory, where there is such a place: inputs are written a thousand times a second.
  if (std::filesystem::exists("/dev/shm")) setenv("TMPDIR", "/dev/shm", 0);
  mujoco::install_message_handlers();
  constexpr char variable[] = "TRIBOTWIN_FUZZ_READER";  // for the processes that libFuzzer starts with its options only
  chosen = *argc > 1 ? find((*argv)[1]) : nullptr;
  if (!chosen && std::getenv(variable)) return chosen = find(std::getenv(variable)), 0;
  if (!chosen) {
    for (const Reader& reader : readers())
      std::printf("%.*s\n", static_cast<int>(reader.name.size()), reader.name.data());
    std::exit(*argc > 1 ? 2 : 0);
  }
  setenv(variable, (*argv)[1], 1);
  std::copy(*argv + 2, *argv + *argc, *argv + 1);
  --*argc;
  return 0;
}

namespace {

void read_file(const Reader& reader, const Path& file) {
  try {
    reader.read(file);
  } catch (const YAML::Exception&) {
    throw;  // a std::runtime_error, but not with a message of ours
  } catch (const std::runtime_error& error) {
    check_message(error.what());
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const Path file = folder() / fmt::format("input{}", chosen->ending);  // stays there after a crash
  std::ofstream(file, std::ios::binary).write(reinterpret_cast<const char*>(data), static_cast<std::streamsize>(size));
  read_file(*chosen, file);
  return 0;
}

namespace {

/// Devices, folders, pipes, files without end: each refused by every reader, within 2 s of CPU and half a GiB.
int read_special_files() {
  const Path place = folder() / "special";
  const auto link = [](const char* target) {
    return [target](const Path& file) { std::filesystem::create_symlink(target, file); };
  };
  const std::pair<const char*, std::function<void(const Path&)>> kinds[] = {
      {"a missing file", [](const Path&) {}},
      {"/dev/zero", link("/dev/zero")},
      {"/dev/null", link("/dev/null")},
      {"a folder", [](const Path& file) { std::filesystem::create_directory(file); }},
      {"a link to itself", [](const Path& file) { std::filesystem::create_symlink(file, file); }},
      {"a pipe without a writer", [](const Path& file) { require(::mkfifo(file.c_str(), 0600) == 0, "no pipe"); }},
      {"a TiB of zeros", [](const Path& file) {
         std::ofstream(file).close();
         std::filesystem::resize_file(file, std::uintmax_t{1} << 40);
       }}};
  interrupted() = true;  // nobody writes into the pipe: Ctrl-C
  for (const Reader& reader : readers())
    for (const auto& [kind, make] : kinds) {
      const Path file = place.string() + std::string(reader.ending);
      make(file);
      const long read_before = read_whole, refused_before = refused;
      const auto start = std::clock();
      read_file(reader, file);
      const double took_s = static_cast<double>(std::clock() - start) / CLOCKS_PER_SEC;
      std::filesystem::remove(file);
      rusage usage{};
      ::getrusage(RUSAGE_SELF, &usage);
      const bool good =
          read_whole == read_before && refused == refused_before + 1 && took_s < 2 && usage.ru_maxrss < 512 * 1024;
      if (!good)
        std::printf("%s, %s: read %ld, refused %ld, %.1f s, %ld KiB\n", std::string(reader.name).c_str(), kind,
                    read_whole - read_before, refused - refused_before, took_s, usage.ru_maxrss);
      require(good, "a special file is not refused at once");
    }
  std::printf("%zu readers refuse %zu kinds of special files\n", readers().size(), std::size(kinds));
  return 0;
}

/// Inputs of libFuzzer's kind, without its knowledge of what was reached: parts of files that are changed, repeated,
/// taken from each other, or replaced by what readers stumble over.
class Mutations {
 public:
  Mutations(std::vector<std::string> files, std::uint64_t seed) : files_(std::move(files)), random_(seed) {}

  std::string next() {
    std::string text = files_[below(files_.size())];
    for (std::size_t n = 1 + below(6); n > 0; --n) change(text);
    return text;
  }

 private:
  std::size_t below(std::size_t end) { return end ? random_() % end : 0; }

  void change(std::string& text) {
    static const std::array<std::string_view, 31> tokens{"-1",
                                                         "0",
                                                         "1e308",
                                                         "-1e-308",
                                                         "nan",
                                                         "inf",
                                                         "9223372036854775808",
                                                         "18446744073709551616",
                                                         "1e999999",
                                                         "~",
                                                         "null",
                                                         "true",
                                                         "[",
                                                         "]",
                                                         "{",
                                                         "}",
                                                         "&a ",
                                                         "*a",
                                                         "<<: ",
                                                         "!!binary ",
                                                         "\xEF\xBB\xBF",
                                                         "\x1B[31m",
                                                         "\xFF\xFE",
                                                         "\xC3",
                                                         "\"",
                                                         "'",
                                                         "\r\n",
                                                         "%s%n",
                                                         "../",
                                                         ",,,",
                                                         "#"};
    const std::size_t at = below(text.size() + 1), length = below(std::size_t{1} << below(8));
    switch (below(6)) {
      case 0:
        if (at < text.size()) text[at] = static_cast<char>(random_());
        break;
      case 1:
        text.erase(at, length);
        break;
      case 2:
        text.insert(at, text.substr(below(text.size()), length));
        break;
      case 3: {
        const std::string& other = files_[below(files_.size())];
        text.replace(at, length, other.substr(below(other.size()), length));
        break;
      }
      case 4:
        text.insert(at, std::string(length, static_cast<char>(below(4) ? random_() : 0)));
        break;
      default:
        replace_word(text, at, tokens[below(tokens.size())]);
    }
  }

  /// The number or word at `at`.
  static void replace_word(std::string& text, std::size_t at, std::string_view token) {
    const auto in_word = [&](std::size_t i) {
      return std::isalnum(static_cast<unsigned char>(text[i])) || text[i] == '.' || text[i] == '-';
    };
    std::size_t end = at;
    while (at > 0 && in_word(at - 1)) --at;
    while (end < text.size() && in_word(end)) ++end;
    text.replace(at, end - at, token);
  }

  std::vector<std::string> files_;
  std::mt19937_64 random_;
};

void read_input(const std::string& bytes) {
  LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
}

}  // namespace

/// Weak, so that libFuzzer's own main wins where it is linked.
[[gnu::weak]] int main(int argc, char** argv) {
  if (argc == 2 && std::string_view(argv[1]) == "special") return read_special_files();
  LLVMFuzzerInitialize(&argc, &argv);
  require(argc > 3, "READER COUNT SEED FILE..");
  std::vector<std::string> files;
  for (int i = 3; i < argc; ++i) read_input(files.emplace_back(or_fail(read_bytes(argv[i]))));
  const long whole = read_whole, count = std::strtol(argv[1], nullptr, 10);
  Mutations mutations(std::move(files), std::strtoull(argv[2], nullptr, 10));
  for (long i = 0; i < count; ++i) read_input(mutations.next());
  std::printf("%s: of %d files %ld read; %ld inputs made of these, %ld read, %ld refused\n",
              std::string(chosen->name).c_str(), argc - 3, whole, count, read_whole - whole, refused);
  return whole > 0 ? 0 : 1;
}
