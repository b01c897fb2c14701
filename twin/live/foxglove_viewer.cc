#include <algorithm>

#include <boost/asio/buffer.hpp>

#include <tribotwin/twin/live/foxglove_viewer.hpp>

namespace tribotwin::twin::live {

void FoxgloveViewer::greet() {
  texts_.push_back(hub_.foxglove_info);
  texts_.push_back(hub_.foxglove_channels);
}

/// Clients subscribe to each topic with a message of its own, to all of them at once when a layout opens.
int FoxgloveViewer::messages_per_s() const {
  return Viewer::messages_per_s() + static_cast<int>(4 * hub_.foxglove_topics.size());
}

void FoxgloveViewer::obey(const std::string& text) {
  const auto heard = subscriptions_.hear(hub_.foxglove_topics, text);
  for (const std::string& answer : heard.answers) tell(std::make_shared<const std::string>(answer));
  for (const auto& added : heard.added) {
    if (added.topic == hub_.foxglove_topics.status() && hub_.status.text) tell_status(hub_.status);
    if (added.topic == hub_.foxglove_topics.events())
      for (const Told& event : hub_.events) tell_event(event);
  }
}

bool FoxgloveViewer::obey_binary() {
  tell(std::make_shared<const std::string>(foxglove::status_text(
      foxglove::Level::error, "binary messages are not understood: this bench takes nothing from its clients")));
  return true;
}

void FoxgloveViewer::queue(std::size_t topic, const Told& told) {
  const auto* subscription = subscriptions_.find(topic);
  if (!subscription) return;
  if (messages_.size() >= hub_.options.limits.texts + hub_.options.limits.events) messages_.pop_front(), lost_ = true;
  messages_.push_back(foxglove::message_head(subscription->id, foxglove::ns_of(told.time_s)) + *told.text);
  send();
}

void FoxgloveViewer::tell_status(const Told& status) { queue(hub_.foxglove_topics.status(), status); }
void FoxgloveViewer::tell_event(const Told& event) { queue(hub_.foxglove_topics.events(), event); }

void FoxgloveViewer::add_row(std::uint64_t number, std::span<const double> row) {
  const auto is_joint = [this](const auto& s) { return hub_.foxglove_topics.is_joint(s.topic); };
  if (std::ranges::any_of(subscriptions_.all(), is_joint)) Viewer::add_row(number, row);
}

/// At most once a second. Lichtblick knows this sentence and says what can be done.
void FoxgloveViewer::tell_losses() {
  const auto now = std::chrono::steady_clock::now();
  if (!lost_ || now < losses_due_) return;
  lost_ = false;
  losses_due_ = now + std::chrono::seconds(1);
  texts_.push_back(std::make_shared<const std::string>(
      foxglove::status_text(foxglove::Level::warning, "Send buffer limit reached", "losses")));
}

bool FoxgloveViewer::take_rows() {
  if (!rows_due_ || row_count_ == 0) return false;
  rows_due_ = false;
  taken_.swap(rows_);
  rows_.clear();
  taken_rows_ = std::exchange(row_count_, 0);
  row_at_ = topic_at_ = 0;
  time_told_ = false;
  return true;
}

/// Clients give a message the last time that they were told: it goes before the messages of each row.
bool FoxgloveViewer::next_of_row() {
  while (row_at_ < taken_rows_) {
    const std::size_t columns = taken_.size() / taken_rows_;
    const auto row = std::span<const double>(taken_).subspan(row_at_ * columns, columns);
    const std::uint64_t ns = foxglove::ns_of(row[0]);
    std::string message;
    if (!std::exchange(time_told_, true)) {
      message = foxglove::time_message(ns);
    } else {
      const std::size_t topic = topic_at_++;
      if (!hub_.foxglove_topics.is_joint(topic)) {
        ++row_at_, topic_at_ = 0, time_told_ = false;
        continue;
      }
      const auto* const subscription = subscriptions_.find(topic);
      if (!subscription) continue;
      message = foxglove::message_head(subscription->id, ns);
      hub_.foxglove_topics.append_joint(message, topic, row);
    }
    batch_.assign(message.begin(), message.end());
    return true;
  }
  return false;
}

void FoxgloveViewer::send_next() {
  tell_losses();
  if (!texts_.empty()) {
    sent_ = std::move(texts_.front());
    texts_.pop_front();
    return write(true, boost::asio::buffer(*sent_));
  }
  if (!messages_.empty()) {
    batch_.assign(messages_.front().begin(), messages_.front().end());
    messages_.pop_front();
    return write(false, boost::asio::buffer(batch_));
  }
  if (next_of_row() || (take_rows() && next_of_row())) write(false, boost::asio::buffer(batch_));
}

}  // namespace tribotwin::twin::live
