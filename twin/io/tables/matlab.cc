#include <algorithm>
#include <optional>

#include <fmt/format.h>
#include <matio.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/telemetry/hdf5.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::tables {
namespace {

namespace fs = std::filesystem;

struct Closer {
  void operator()(mat_t* mat) const {
    const hdf5::Hdf5 silent;  // it closes what a damaged file has not opened
    Mat_Close(mat);
  }
  void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};
using Mat = std::unique_ptr<mat_t, Closer>;
using Variable = std::unique_ptr<matvar_t, Closer>;

/// Bytes of one number of a class; 0: no real numbers.
std::size_t number_bytes(const matvar_t& v) {
  if (v.isComplex) return 0;
  switch (v.class_type) {
    case MAT_C_DOUBLE:
    case MAT_C_INT64:
    case MAT_C_UINT64:
      return 8;
    case MAT_C_SINGLE:
    case MAT_C_INT32:
    case MAT_C_UINT32:
      return 4;
    case MAT_C_INT16:
    case MAT_C_UINT16:
      return 2;
    case MAT_C_INT8:
    case MAT_C_UINT8:
      return 1;
    default:
      return 0;
  }
}

double number_at(const matvar_t& v, std::size_t i) {
  const auto as = [&]<class T>(T) { return static_cast<double>(static_cast<const T*>(v.data)[i]); };
  switch (v.class_type) {
    case MAT_C_DOUBLE:
      return as(double{});
    case MAT_C_SINGLE:
      return as(float{});
    case MAT_C_INT64:
      return as(std::int64_t{});
    case MAT_C_UINT64:
      return as(std::uint64_t{});
    case MAT_C_INT32:
      return as(std::int32_t{});
    case MAT_C_UINT32:
      return as(std::uint32_t{});
    case MAT_C_INT16:
      return as(std::int16_t{});
    case MAT_C_UINT16:
      return as(std::uint16_t{});
    case MAT_C_INT8:
      return as(std::int8_t{});
    default:
      return as(std::uint8_t{});
  }
}

/// A matrix of real numbers in a variable: the variable and the fields of structs that lead to it.
struct Place {
  std::vector<std::string> path;
  std::vector<std::size_t> sides;  ///< as matrix_sides: two, or more where it is no matrix
};

std::vector<std::size_t> sides_of(const matvar_t& v) { return matrix_sides({v.dims, v.dims + v.rank}); }

void find_matrices(const matvar_t& v, std::vector<std::string> path, std::vector<Place>& out) {
  if (path.size() > limits::struct_depth || v.rank < 2 || !v.dims) return;
  if (number_bytes(v) > 0) {
    if (auto sides = sides_of(v); std::ranges::find(sides, 0u) == sides.end())
      out.push_back({std::move(path), std::move(sides)});
    return;
  }
  if (v.class_type != MAT_C_STRUCT || v.rank != 2 || v.dims[0] != 1 || v.dims[1] != 1) return;
  char* const* names = Mat_VarGetStructFieldnames(&v);
  for (unsigned k = 0; names && k < Mat_VarGetNumberOfFields(const_cast<matvar_t*>(&v)); ++k)
    if (const matvar_t* field = Mat_VarGetStructFieldByIndex(const_cast<matvar_t*>(&v), k, 0); field && names[k]) {
      auto longer = path;
      longer.emplace_back(names[k]);
      find_matrices(*field, std::move(longer), out);
    }
}

class MatlabSource final : public ArraySource {
 public:
  explicit MatlabSource(fs::path file) : file_(std::move(file)) {}

  const std::vector<std::string>& headers() const override { return headers_; }

  Result<void> open() {
    const hdf5::Hdf5 one_at_a_time;  // MAT 7.3 is HDF5
    mat_.reset(Mat_Open(file_.c_str(), MAT_ACC_RDONLY));
    if (!mat_) return tl::unexpected(fmt::format("{}: is no readable MATLAB file (v4 to v7.3)", file_.string()));
    while (const Variable v{Mat_VarReadNextInfo(mat_.get())}) {
      if (!v->name) continue;
      std::vector<Place> places;
      find_matrices(*v, {v->name}, places);
      for (auto& place : places) {
        std::string name = joined(place.path, ".");
        for (const Stripe& stripe : stripes_of(name, place.sides, true, '(', ')', 1)) {
          headers_.push_back(stripe.name);
          columns_.push_back({places_.size(), stripe});
        }
        places_.push_back(std::move(place));
      }
      if (headers_.size() > limits::array_columns)
        return tl::unexpected(fmt::format("{}: has more than {} columns", file_.string(), limits::array_columns));
    }
    if (headers_.empty())
      return tl::unexpected(fmt::format("{}: holds no matrix of real numbers, alone or in structs", file_.string()));
    return {};
  }

  Result<std::vector<double>> column(std::size_t header) override {
    const auto& [at, stripe] = columns_[header];
    const Place& place = places_[at];
    const auto fail = [&](const std::string& why) {
      return tl::unexpected(Error(fmt::format("{}: {}: {}", file_.string(), shown(joined(place.path, ".")), why)));
    };
    if (place.sides.size() > 2) return fail(no_matrix(place.sides));
    if (const auto bytes = bytes_of(place.path.front()); !bytes || *bytes > limits::array_bytes)
      return fail(fmt::format("is longer than the {} bytes that are read at most", limits::array_bytes));
    else if (*bytes / limits::best_compression > fs::file_size(file_))
      return fail(
          fmt::format("promises {} bytes of numbers, which a file of {} cannot hold", *bytes, fs::file_size(file_)));
    const hdf5::Hdf5 one_at_a_time;
    if (!loaded_ || loaded_name_ != place.path.front()) {
      loaded_.reset(Mat_VarRead(mat_.get(), place.path.front().c_str()));
      loaded_name_ = place.path.front();
    }
    const matvar_t* v = loaded_.get();
    for (std::size_t k = 1; v && k < place.path.size(); ++k)
      v = Mat_VarGetStructFieldByName(const_cast<matvar_t*>(v), place.path[k].c_str(), 0);
    if (!v || !v->data || sides_of(*v) != place.sides || number_bytes(*v) == 0 ||
        v->nbytes < place.sides[0] * place.sides[1] * number_bytes(*v))
      return fail("cannot be read; the file is damaged");
    std::vector<double> values(stripe.count);
    for (std::size_t i = 0; i < values.size(); ++i) values[i] = number_at(*v, stripe.begin + i * stripe.step);
    return values;
  }

 private:
  /// Of all matrices in a variable, which is read as a whole; nothing where that is more than any memory.
  std::optional<std::uintmax_t> bytes_of(const std::string& variable) const {
    std::uintmax_t sum = 0;
    for (const Place& place : places_) {
      if (place.path.front() != variable) continue;
      std::uintmax_t bytes = 8;
      for (const std::size_t side : place.sides)
        if (__builtin_mul_overflow(bytes, side, &bytes)) return std::nullopt;
      if (__builtin_add_overflow(sum, bytes, &sum)) return std::nullopt;
    }
    return sum;
  }

  fs::path file_;
  Mat mat_;
  std::vector<Place> places_;
  std::vector<std::pair<std::size_t, Stripe>> columns_;
  std::vector<std::string> headers_;
  Variable loaded_;
  std::string loaded_name_;
};

/// Reads everything once, for the child process: damaged files crash the libraries.
void read_everything(const fs::path& file) {
  MatlabSource source(file);
  if (!source.open()) return;
  for (std::size_t k = 0; k < source.headers().size(); ++k) (void)source.column(k);
}

}  // namespace

Opened open_matlab(const fs::path& file) {
  if (const auto stream = open_text(file, "a MATLAB file"); !stream) return tl::unexpected(stream.error());
  if (const auto why = cut_off(file)) return tl::unexpected(fmt::format("{}: {}", file.string(), *why));
  const auto whole = hdf5::guarded(file, "is no readable MATLAB file", [&] {
    if (!hdf5::survives([&] { read_everything(file); }, hdf5::memory_for(file)))
      throw hdf5::Failure(
          "it is damaged so that the library for such files crashes on it or wants memory without end, or this machine "
          "has too little");
  });
  if (!whole) return tl::unexpected(Error(whole.error().message));
  auto source = std::make_unique<MatlabSource>(file);
  if (auto ok = source->open(); !ok) return tl::unexpected(ok.error());
  return source;
}

}  // namespace tribotwin::twin::tables
