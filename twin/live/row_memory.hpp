#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <memory>
#include <span>
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
  const std::size_t columns_, rows_per_block_, most_blocks_;
  std::deque<std::shared_ptr<const Block>> blocks_;  // full
  std::shared_ptr<Block> last_;                      // is being filled; empty only at the beginning
};

}  // namespace tribotwin::twin::live
