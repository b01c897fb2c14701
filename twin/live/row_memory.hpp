#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
#include <utility>
#include <vector>

namespace tribotwin::twin::live {

/// The last rows, as many as a bounded memory holds. The first value of a row is its time [s].
class RowMemory {
 public:
  /// Rows of these columns that came after each other; some may be missing between them.
  struct Block {
    std::vector<double> values;
    std::vector<std::uint64_t> numbers;
  };
  /// Rows that stay as they are while further ones come. Shares its blocks with the memory.
  class Rows {
   public:
    Rows(std::size_t columns, std::vector<std::shared_ptr<const Block>> blocks, double since_s);
    std::size_t size() const { return size_; }
    /// How many are missing between them.
    std::uint64_t missing() const { return missing_; }
    double first_s() const { return first_s_; }
    double last_s() const { return last_s_; }
    /// Calls `take(row)` for each until it is false; whether it was so for all.
    template <class Take>
    bool each(Take&& take) const {
      for (const auto& block : blocks_)
        for (std::size_t i = block == blocks_.front() ? skipped_ : 0; i < block->numbers.size(); ++i)
          if (!take(std::span<const double>(block->values).subspan(i * columns_, columns_))) return false;
      return true;
    }

   private:
    std::size_t columns_;
    std::vector<std::shared_ptr<const Block>> blocks_;
    std::size_t skipped_ = 0, size_ = 0;  // skipped_: rows of the first block
    std::uint64_t missing_ = 0;
    double first_s_ = 0, last_s_ = 0;
  };

  RowMemory(std::size_t columns, std::size_t bytes);
  void add(std::uint64_t number, std::span<const double> row);
  bool empty() const { return last_->numbers.empty(); }
  /// Those of the last `seconds` (more than 0) before the newest, of a memory that is not empty.
  Rows last(double seconds) const;
  /// How many rows there are room for.
  std::size_t capacity() const { return rows_per_block_ * most_blocks_; }

 private:
  static constexpr std::size_t block_bytes = 1 << 20;
  static constexpr std::size_t bytes_of_row(std::size_t columns) {
    return columns * sizeof(double) + sizeof(std::uint64_t);
  }
  const std::size_t columns_, rows_per_block_, most_blocks_;
  std::deque<std::shared_ptr<const Block>> blocks_;  // full
  std::shared_ptr<Block> last_;                      // is being filled; empty only at the beginning
};

inline RowMemory::RowMemory(std::size_t columns, std::size_t bytes)
    : columns_(columns),
      rows_per_block_(std::max<std::size_t>(1, std::min(bytes, block_bytes) / bytes_of_row(columns))),
      most_blocks_(std::max<std::size_t>(1, bytes / (rows_per_block_ * bytes_of_row(columns)))),
      last_(std::make_shared<Block>()) {}

inline void RowMemory::add(std::uint64_t number, std::span<const double> row) {
  if (last_->numbers.size() == rows_per_block_) {
    blocks_.push_back(std::move(last_));
    last_ = std::make_shared<Block>();
    if (blocks_.size() >= most_blocks_) blocks_.pop_front();
  }
  if (last_->numbers.empty()) {
    last_->values.reserve(rows_per_block_ * columns_);
    last_->numbers.reserve(rows_per_block_);
  }
  last_->values.insert(last_->values.end(), row.begin(), row.end());
  last_->numbers.push_back(number);
}

inline RowMemory::Rows RowMemory::last(double seconds) const {
  const double since_s = last_->values[last_->values.size() - columns_] - seconds;
  std::vector<std::shared_ptr<const Block>> taken;
  for (const auto& block : blocks_)
    if (block->values[block->values.size() - columns_] > since_s) taken.push_back(block);
  taken.push_back(std::make_shared<const Block>(*last_));
  return {columns_, std::move(taken), since_s};
}

inline RowMemory::Rows::Rows(std::size_t columns, std::vector<std::shared_ptr<const Block>> blocks, double since_s)
    : columns_(columns), blocks_(std::move(blocks)) {
  const Block &first = *blocks_.front(), &last = *blocks_.back();
  while (first.values[skipped_ * columns_] <= since_s) ++skipped_;
  for (const auto& block : blocks_) size_ += block->numbers.size();
  size_ -= skipped_;
  missing_ = last.numbers.back() - first.numbers[skipped_] + 1 - size_;
  first_s_ = first.values[skipped_ * columns_];
  last_s_ = last.values[last.values.size() - columns_];
}

}  // namespace tribotwin::twin::live
