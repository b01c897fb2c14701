#pragma once

#include <array>
#include <atomic>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <utility>
#include <vector>

/// Ways from one thread to one other that neither lock nor wait: what has no room is refused at once.
namespace tribotwin::twin::live {

/// Where writer and reader of a ring are; each counts up without end.
class RingPlaces {
 public:
  explicit RingPlaces(std::size_t capacity) : capacity_(capacity) {}
  /// The writer's next place, if the reader has left it.
  std::optional<std::size_t> free() const {
    const std::size_t written = written_.load(std::memory_order_relaxed);
    if (written - read_.load(std::memory_order_acquire) == capacity_) return std::nullopt;
    return written & (capacity_ - 1);
  }
  void wrote() { written_.store(written_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }
  /// The reader's next place, if the writer has filled it.
  std::optional<std::size_t> filled() const {
    const std::size_t read = read_.load(std::memory_order_relaxed);
    if (read == written_.load(std::memory_order_acquire)) return std::nullopt;
    return read & (capacity_ - 1);
  }
  void took() { read_.store(read_.load(std::memory_order_relaxed) + 1, std::memory_order_release); }

 private:
  const std::size_t capacity_;  // a power of two
  // Each in a cache line of its own: the threads write them all the time.
  alignas(64) std::atomic<std::size_t> written_{0};
  alignas(64) std::atomic<std::size_t> read_{0};
};

/// Rows of doubles. They are numbered from 0, those that had no room included: a gap says how many were lost.
class RowRing {
 public:
  /// Holds at least `rows`.
  RowRing(std::size_t columns, std::size_t rows)
      : columns_(columns),
        places_(std::bit_ceil(rows)),
        numbers_(std::bit_ceil(rows)),
        values_(std::bit_ceil(rows) * columns) {}

  std::size_t columns() const { return columns_; }
  /// Of the writer: the number of the next row.
  std::uint64_t next() const { return next_; }
  /// Of the writer: `fill(row)` writes a row in its place. False where it was lost.
  template <class Fill>
  bool push(Fill&& fill) {
    const std::uint64_t number = next_++;
    const auto place = places_.free();
    if (!place) return false;
    numbers_[*place] = number;
    fill(std::span<double>(values_).subspan(*place * columns_, columns_));
    places_.wrote();
    return true;
  }
  /// Of the reader: calls `take(number, row)` for all that are there.
  template <class Take>
  void drain(Take&& take) {
    while (const auto place = places_.filled()) {
      take(numbers_[*place], std::span<const double>(values_).subspan(*place * columns_, columns_));
      places_.took();
    }
  }

 private:
  std::size_t columns_;
  RingPlaces places_;
  std::uint64_t next_ = 0;  // of the writer
  std::vector<std::uint64_t> numbers_;
  std::vector<double> values_;
};

/// The newest of many; what the reader did not take in time is gone. Three places: writer and reader have one each, and
/// swap it for the third.
class Newest {
 public:
  explicit Newest(std::size_t values) : places_{Place{values}, Place{values}, Place{values}} {}

  /// Of the writer: `fill(values)` writes them in their place.
  template <class Fill>
  void write(std::uint64_t number, Fill&& fill) {
    Place& place = places_[written_];
    place.number = number;
    fill(std::span<float>(place.values));
    written_ = between_.exchange(written_ | fresh, std::memory_order_acq_rel) & ~fresh;
  }
  /// Of the reader: calls `take(number, values)` if there is something new; whether there was.
  template <class Take>
  bool read(Take&& take) {
    if (!(between_.load(std::memory_order_relaxed) & fresh)) return false;
    read_ = between_.exchange(read_, std::memory_order_acq_rel) & ~fresh;
    const Place& place = places_[read_];
    take(place.number, std::span<const float>(place.values));
    return true;
  }

 private:
  static constexpr unsigned fresh = 4;  // beside the number of a place
  struct Place {
    explicit Place(std::size_t size) : values(size) {}
    std::uint64_t number = 0;
    std::vector<float> values;
  };
  std::array<Place, 3> places_;
  unsigned written_ = 0;  // of the writer
  alignas(64) std::atomic<unsigned> between_{1};
  alignas(64) unsigned read_ = 2;  // of the reader
};

/// A few messages.
template <class T, std::size_t capacity>
class Queue {
  static_assert(std::has_single_bit(capacity));

 public:
  /// Of the writer: false where there was no room.
  bool push(T message) {
    const auto place = places_.free();
    if (!place) return false;
    messages_[*place] = std::move(message);
    places_.wrote();
    return true;
  }
  /// Of the writer: whether the next one will have.
  bool has_room() const { return places_.free().has_value(); }
  /// Of the reader: the oldest.
  std::optional<T> take() {
    const auto place = places_.filled();
    if (!place) return std::nullopt;
    std::optional<T> message(std::move(messages_[*place]));
    places_.took();
    return message;
  }

 private:
  RingPlaces places_{capacity};
  std::array<T, capacity> messages_;
};

}  // namespace tribotwin::twin::live
