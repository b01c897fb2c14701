#pragma once

#include <cerrno>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <hdf5.h>

#include <tribotwin/plugins/friction/error.hpp>
#include <tribotwin/twin/io/telemetry/telemetry.hpp>

/// HDF5 for this folder: one thread at a time, failures as exceptions that do not leave the folder, ids that close
/// themselves.
namespace tribotwin::twin::hdf5 {

namespace fs = std::filesystem;
using Status = Result<void>;

constexpr char no_record[] = "is no readable HDF5 record";
constexpr char no_table[] = "is no readable HDF5 table";
constexpr char not_written[] = "cannot be written";

/// The reason why something failed.
struct Failure : std::runtime_error {
  using std::runtime_error::runtime_error;
};

std::string system_reason(int error);

/// Result of `work`, or the message "FILE: PHRASE (reason)" for any exception: a record or table that cannot be read is
/// wrong input, one that cannot be written is failed work.
template <class Work>
auto guarded(const fs::path& path, std::string_view phrase, Work&& work) -> Result<decltype(work())> {
  const ErrorKind kind = phrase == no_record || phrase == no_table ? ErrorKind::input : ErrorKind::work;
  try {
    if constexpr (std::is_void_v<decltype(work())>) {
      work();
      return {};
    } else {
      return work();
    }
  } catch (const std::bad_alloc&) {
    return work_failed(fmt::format("{}: {} (out of memory)", path.string(), phrase));
  } catch (const std::exception& e) {
    return tl::unexpected(Error(fmt::format("{}: {} ({})", path.string(), phrase, e.what()), kind));
  } catch (...) {
    return tl::unexpected(Error(fmt::format("{}: {} (unknown reason)", path.string(), phrase), kind));
  }
}

/// One thread in HDF5 at a time, held per block and not per sample; HDF5 prints no errors meanwhile.
class Hdf5 {
 public:
  Hdf5();
  ~Hdf5();
  Hdf5(const Hdf5&) = delete;

 private:
  std::unique_lock<std::recursive_mutex> lock_;
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

/// What `work` does in a child process, which inherits the lock on HDF5: false where the child was ended by a signal,
/// as HDF5 1.10 is by some damaged files, or wanted more memory than `most_bytes`. The child's result is otherwise
/// ignored, and it says nothing.
bool survives(const std::function<void()>& work, std::uintmax_t most_bytes);

/// The memory that reading a file may take: all that it can hold, compressed, twice, and limits::library_bytes.
std::uintmax_t memory_for(const fs::path& file);

/// HDF5's innermost reason for the last failure. The next HDF5 call, closing an id included, clears it.
std::string hdf5_reason();

template <class Result>
Result check(Result result) {
  if (result < 0) throw Failure(hdf5_reason());
  return result;
}

/// Owns an HDF5 id.
class Id {
 public:
  Id() = default;
  Id(hid_t id, herr_t (*closer)(hid_t)) : id_(check(id)), close_(closer) {}
  Id(Id&& other) noexcept : id_(std::exchange(other.id_, -1)), close_(other.close_) {}
  Id& operator=(Id&& other) noexcept {
    std::swap(id_, other.id_);
    std::swap(close_, other.close_);
    return *this;
  }
  ~Id() { (void)close(); }
  herr_t close() {
    if (id_ < 0) return 0;
    const Hdf5 hdf5;
    return close_(std::exchange(id_, -1));
  }
  /// Gives the id up without closing it.
  void abandon() { id_ = -1; }
  operator hid_t() const { return id_; }
  explicit operator bool() const { return id_ >= 0; }

 private:
  hid_t id_ = -1;
  herr_t (*close_)(hid_t) = nullptr;
};

/// Whether a group keeps the order in which its links or attributes were made; `of`: H5Pget_link_creation_order or
/// H5Pget_attr_creation_order. Where it does, an order that cannot be read is damaged.
bool keeps_order(hid_t group, herr_t (*of)(hid_t, unsigned*));

/// The string and the numeric attributes of a group.
std::pair<std::vector<std::pair<std::string, std::string>>, NumericAttributes> read_attributes(hid_t group);
/// Empty where there is no such attribute.
std::string read_text(hid_t object, const char* name);

void write_attribute(hid_t object, const std::string& name, hid_t type, const void* value);
void write_attribute(hid_t object, const std::string& name, const std::string& value);

void write_rows(hid_t dataset, hsize_t from, std::span<const double> values);

}  // namespace tribotwin::twin::hdf5
