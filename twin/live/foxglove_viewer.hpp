#pragma once

#include <tribotwin/twin/live/protocol/foxglove.hpp>
#include <tribotwin/twin/live/viewer.hpp>

namespace tribotwin::twin::live {

/// A client of Foxglove's protocol. It only listens; rows that it cannot take in time are lost to it, and it is told.
class FoxgloveViewer final : public Viewer {
 public:
  using Viewer::Viewer;
  void tell_status(const Told& status) override;
  void tell_event(const Told& event) override;
  void tell_poses(Text) override {}
  void add_row(std::uint64_t number, std::span<const double> row) override;
  bool idle() const override { return Viewer::idle() && messages_.empty() && row_at_ == taken_rows_; }

 private:
  void greet() override;
  void obey(const std::string& text) override;
  bool obey_binary() override;
  int messages_per_s() const override;
  void send_next() override;
  bool next_of_row();
  bool take_rows();
  void tell_losses();
  void queue(std::size_t topic, const Told& told);

  foxglove::Subscriptions subscriptions_;
  std::deque<std::string> messages_;  // of /status and /events
  // Rows that are sent now: message by message of each.
  std::vector<double> taken_;
  std::size_t taken_rows_ = 0, row_at_ = 0, topic_at_ = 0;
  bool time_told_ = false;  // of this row
  std::chrono::steady_clock::time_point losses_due_;
};

}  // namespace tribotwin::twin::live
