#include <utility>

#include <tribotwin/hil/session/session_record.hpp>

namespace tribotwin::hil {

Result<SessionRecord> SessionRecord::create(const std::filesystem::path& log, const SessionHead& head, bool replace) {
  const std::filesystem::path beside = session_file_of(log);
  auto frames = LogWriter::create(log, channel_of(0), {.replace = replace});
  if (!frames) return tl::unexpected(frames.error());
  std::optional<SessionWriter> session;
  if (!beside.empty()) {
    auto turns = SessionWriter::create(beside, head, {.replace = replace});
    if (!turns) return tl::unexpected(turns.error());
    session = std::move(*turns);
  }
  return SessionRecord(std::move(*frames), std::move(session), head.start_ns);
}

void SessionRecord::begin(std::int64_t time_ns) {
  turn_ = {.time_ns = time_ns};
  turn_.events = std::exchange(events_, {});
  turn_.hold = std::exchange(hold_, std::nullopt);
  frames_ = keeps_ = 0;
}

Result<void> SessionRecord::frame(std::size_t bus, Frame frame, bool misleading) {
  frame.time_ns = turn_.time_ns;
  if (misleading) turn_.misleading.push_back(frames_);
  ++frames_;
  return bus == 0 ? log_.write(frame) : log_.write(frame, channel_of(bus));
}

Result<void> SessionRecord::end() {
  const bool says_more = turn_.steps > 0 || !turn_.recovered.empty() || !turn_.misleading.empty() ||
                         !turn_.faults.empty() || !turn_.not_kept.empty() || !turn_.events.empty() || turn_.hold ||
                         frames_ == 0;
  return session_ && says_more ? session_->write(turn_) : Result<void>{};
}

Result<void> SessionRecord::flush() {
  if (auto ok = log_.flush(); !ok) return ok;
  return session_ ? session_->flush() : Result<void>{};
}

Result<void> SessionRecord::finish() {
  if (!events_.empty() || hold_) {
    begin(turn_.time_ns);
    if (auto ok = end(); !ok) return ok;
  }
  if (auto ok = log_.finish(); !ok) return ok;
  return session_ ? session_->finish() : Result<void>{};
}

}  // namespace tribotwin::hil
