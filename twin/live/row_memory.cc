#include <algorithm>

#include <tribotwin/twin/live/row_memory.hpp>

namespace tribotwin::twin::live {
namespace {

constexpr std::size_t block_bytes = 1 << 20;

std::size_t bytes_of_row(std::size_t columns) { return columns * sizeof(double) + sizeof(std::uint64_t); }

}  // namespace

RowMemory::RowMemory(std::size_t columns, std::size_t bytes)
    : columns_(columns),
      rows_per_block_(std::max<std::size_t>(1, std::min(bytes, block_bytes) / bytes_of_row(columns))),
      most_blocks_(std::max<std::size_t>(1, bytes / (rows_per_block_ * bytes_of_row(columns)))),
      last_(std::make_shared<Block>()) {}

void RowMemory::add(std::uint64_t number, std::span<const double> row) {
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

RowMemory::Rows RowMemory::last(double seconds) const {
  const double since_s = last_->values[last_->values.size() - columns_] - seconds;
  std::vector<std::shared_ptr<const Block>> taken;
  for (const auto& block : blocks_)
    if (block->values[block->values.size() - columns_] > since_s) taken.push_back(block);
  taken.push_back(std::make_shared<const Block>(*last_));
  return {columns_, std::move(taken), since_s};
}

RowMemory::Rows::Rows(std::size_t columns, std::vector<std::shared_ptr<const Block>> blocks, double since_s)
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
