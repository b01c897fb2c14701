#include <algorithm>
#include <bit>
#include <cstring>
#include <fstream>
#include <optional>

#include <fmt/format.h>
#include <zip.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/plugins/friction/number.hpp>
#include <tribotwin/twin/io/tables/numpy_header.hpp>
#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::tables {
namespace {

namespace fs = std::filesystem;

/// The bytes of one array, from a file or from an entry of an archive.
class Stream {
 public:
  virtual ~Stream() = default;
  /// How many bytes were read: fewer than asked for at the end only, or at a fault.
  virtual std::size_t read(char* to, std::size_t count) = 0;
};

class FileStream final : public Stream {
 public:
  explicit FileStream(std::ifstream stream) : stream_(std::move(stream)) {}
  std::size_t read(char* to, std::size_t count) override {
    stream_.read(to, static_cast<std::streamsize>(count));
    return static_cast<std::size_t>(stream_.gcount());
  }

 private:
  std::ifstream stream_;
};

class ZipStream final : public Stream {
 public:
  explicit ZipStream(zip_file_t* file) : file_(file, zip_fclose) {}
  std::size_t read(char* to, std::size_t count) override {
    std::size_t done = 0;
    while (done < count) {
      const auto got = zip_fread(file_.get(), to + done, count - done);
      if (got <= 0) break;
      done += static_cast<std::size_t>(got);
    }
    return done;
  }

 private:
  std::unique_ptr<zip_file_t, int (*)(zip_file_t*)> file_;
};

/// An array: its name and how its bytes are read again.
struct Array {
  std::string name;
  zip_int64_t entry = -1;  ///< of the archive; -1: the file itself
  NumpyHeader header;
};

double number_at(const char* at, const NumpyField& field) {
  char bytes[8];
  std::memcpy(bytes, at, field.size);
  if (field.swapped) std::reverse(bytes, bytes + field.size);
  const auto as = [&]<class T>(T value) {
    std::memcpy(&value, bytes, sizeof value);
    return static_cast<double>(value);
  };
  switch (field.kind) {
    case 'f':
      return field.size == 8 ? as(double{}) : as(float{});
    case 'i':
      return field.size == 8   ? as(std::int64_t{})
             : field.size == 4 ? as(std::int32_t{})
             : field.size == 2 ? as(std::int16_t{})
                               : as(std::int8_t{});
    default:
      return field.size == 8   ? as(std::uint64_t{})
             : field.size == 4 ? as(std::uint32_t{})
             : field.size == 2 ? as(std::uint16_t{})
                               : as(std::uint8_t{});
  }
}

class NumpySource final : public ArraySource {
 public:
  NumpySource(fs::path file, std::unique_ptr<zip_t, void (*)(zip_t*)> archive)
      : file_(std::move(file)), archive_(std::move(archive)) {}

  const std::vector<std::string>& headers() const override { return headers_; }

  /// Reads the headers of all arrays.
  Result<void> open() {
    if (!archive_) return add({.name = "", .entry = -1, .header = {}});
    const auto entries = zip_get_num_entries(archive_.get(), 0);
    if (entries > std::int64_t{limits::archive_files})
      return tl::unexpected(
          fmt::format("{}: holds {} files; at most {} are read", file_.string(), entries, limits::archive_files));
    for (zip_int64_t entry = 0; entry < entries; ++entry) {
      const char* raw = zip_get_name(archive_.get(), static_cast<zip_uint64_t>(entry), ZIP_FL_ENC_RAW);
      std::string name = raw ? raw : "";
      if (!name.ends_with(".npy")) continue;
      name.resize(name.size() - 4);
      if (auto ok = add({.name = std::move(name), .entry = entry, .header = {}}); !ok) return ok;
    }
    if (headers_.empty()) return tl::unexpected(fmt::format("{}: holds no array of numbers (.npy)", file_.string()));
    return {};
  }

 private:
  /// A column: a stripe through the numbers of one field of one array.
  struct Column {
    std::size_t array;
    NumpyField field;
    Stripe stripe;
    std::vector<std::size_t> sides;  ///< matrix_sides
  };

  Result<std::unique_ptr<Stream>> stream_of(const Array& array) const {
    if (array.entry < 0) {
      auto stream = open_text(file_, "a NumPy array");
      if (!stream) return tl::unexpected(stream.error());
      return std::make_unique<FileStream>(std::move(*stream));
    }
    zip_file_t* opened = zip_fopen_index(archive_.get(), static_cast<zip_uint64_t>(array.entry), 0);
    if (!opened)
      return tl::unexpected(
          fmt::format("{}: {}: cannot be read ({})", file_.string(), shown(array.name), zip_strerror(archive_.get())));
    return std::make_unique<ZipStream>(opened);
  }

  /// How many bytes the array has in its file, as far as that is known before it is read.
  std::optional<std::uintmax_t> stored_bytes(const Array& array) const {
    if (array.entry < 0) {
      std::error_code error;
      const auto size = fs::file_size(file_, error);
      return error ? std::nullopt : std::optional(size);
    }
    zip_stat_t stat;
    if (zip_stat_index(archive_.get(), static_cast<zip_uint64_t>(array.entry), 0, &stat) != 0 ||
        !(stat.valid & ZIP_STAT_SIZE))
      return std::nullopt;
    return stat.size;
  }

  std::string where(const Array& array) const {
    return array.entry < 0 ? file_.string() : fmt::format("{}: {}", file_.string(), shown(array.name));
  }

  Result<void> add(Array array) {
    auto stream = stream_of(array);
    if (!stream) return tl::unexpected(stream.error());
    const auto header = read_numpy_header([&](char* to, std::size_t count) { return (*stream)->read(to, count); });
    if (!header) return tl::unexpected(fmt::format("{}: {}", where(array), header.error().message));
    array.header = *header;
    const auto& shape = array.header.shape;
    std::uintmax_t bytes = array.header.item_bytes;
    for (const std::size_t n : shape)
      if (__builtin_mul_overflow(bytes, n, &bytes))
        return tl::unexpected(fmt::format("{}: its shape is larger than any memory", where(array)));
    if (const auto stored = stored_bytes(array); stored && bytes + array.header.header_bytes > *stored)
      return tl::unexpected(fmt::format("{}: is cut off: its header promises {} bytes of numbers, the file holds {}",
                                        where(array), bytes,
                                        *stored - std::min<std::uintmax_t>(*stored, array.header.header_bytes)));
    for (const NumpyField& field : array.header.fields) add_field(array, field);
    if (headers_.size() > limits::array_columns)
      return tl::unexpected(
          fmt::format("{}: has more than {} columns, the most that are read", file_.string(), limits::array_columns));
    arrays_.push_back(std::move(array));
    return {};
  }

  /// The columns of a field: of the array's matrix, or of the rows that a field has in each item.
  void add_field(const Array& array, const NumpyField& field) {
    const std::string name = field.name.empty()   ? array.name
                             : array.name.empty() ? field.name
                                                  : fmt::format("{}.{}", array.name, field.name);
    if (array.header.shape.empty()) return;
    std::vector<std::size_t> sides = array.header.shape;
    if (field.count != 1) sides.push_back(field.count);
    sides = matrix_sides(std::move(sides));
    const bool by_column = array.header.fortran_order && field.count == 1;
    for (const Stripe& stripe : stripes_of(name, sides, by_column, '[', ']', 0)) {
      headers_.push_back(stripe.name);
      columns_.push_back({arrays_.size(), field, stripe, sides});
    }
  }

  Result<std::vector<double>> column(std::size_t header) override {
    const Column& c = columns_[header];
    const Array& array = arrays_[c.array];
    const auto fail = [&](const std::string& why) {
      return tl::unexpected(Error(fmt::format("{}: {}", where(array), why)));
    };
    if (c.field.kind == 'O') return fail("holds Python objects, which are not read; save plain numbers");
    if (c.sides.size() > 2) return fail(no_matrix(c.sides));
    if (!c.field.number())
      return fail(fmt::format("is of type '{}{}', no numbers; accepted are f4, f8, i1 to i8, u1 to u8, b1",
                              printable({&c.field.kind, 1}), c.field.size));
    if (loaded_ != c.array) {
      std::uintmax_t bytes = array.header.item_bytes;
      for (const std::size_t n : array.header.shape) bytes *= n;
      if (bytes > limits::array_bytes)
        return fail(fmt::format("is {} bytes long; at most {} are read", bytes, limits::array_bytes));
      auto stream = stream_of(array);
      if (!stream) return tl::unexpected(stream.error());
      std::string skipped(array.header.header_bytes, '\0');
      // Grows with what is there: an archive's promise costs no memory.
      bytes_.clear();
      constexpr std::size_t step = std::size_t{1} << 20;
      bool whole = (*stream)->read(skipped.data(), skipped.size()) == skipped.size();
      while (whole && bytes_.size() < bytes) {
        const std::size_t from = bytes_.size(), count = std::min<std::uintmax_t>(step, bytes - from);
        bytes_.resize(from + count);
        whole = (*stream)->read(bytes_.data() + from, count) == count;
      }
      if (!whole) return fail("cannot be read to its end; the file is damaged");
      loaded_ = c.array;
    }
    // Fields of an item lie side by side; a plain array has one per item.
    const bool in_items = array.header.shape.size() == 1 || c.field.count != 1;
    std::vector<double> values(c.stripe.count);
    for (std::size_t i = 0; i < values.size(); ++i) {
      const std::size_t at = c.stripe.begin + i * c.stripe.step,
                        offset = in_items ? at / c.field.count * array.header.item_bytes + c.field.offset +
                                                at % c.field.count * c.field.size
                                          : at * array.header.item_bytes + c.field.offset;
      values[i] = number_at(bytes_.data() + offset, c.field);
    }
    return values;
  }

  fs::path file_;
  std::unique_ptr<zip_t, void (*)(zip_t*)> archive_;
  std::vector<Array> arrays_;
  std::vector<Column> columns_;
  std::vector<std::string> headers_;
  std::size_t loaded_ = static_cast<std::size_t>(-1);
  std::string bytes_;  // of the array that was read last
};

}  // namespace

Opened open_numpy(const fs::path& file) {
  auto stream = open_text(file, "a NumPy array");
  if (!stream) return tl::unexpected(stream.error());
  char magic[2] = {};
  stream->read(magic, 2);
  std::unique_ptr<zip_t, void (*)(zip_t*)> archive(nullptr, zip_discard);
  if (magic[0] == 'P' && magic[1] == 'K') {
    int code = 0;
    archive.reset(zip_open(file.c_str(), ZIP_RDONLY, &code));
    if (!archive) {
      zip_error_t error;
      zip_error_init_with_code(&error, code);
      const std::string why = zip_error_strerror(&error);
      zip_error_fini(&error);
      return tl::unexpected(fmt::format("{}: is no readable .npz archive ({})", file.string(), why));
    }
  }
  auto source = std::make_unique<NumpySource>(file, std::move(archive));
  if (auto ok = source->open(); !ok) return tl::unexpected(ok.error());
  return source;
}

}  // namespace tribotwin::twin::tables
