#include <algorithm>
#include <chrono>
#include <limits>
#include <utility>

#include <fmt/format.h>

#include <tribotwin/twin/io/telemetry/mcap_rows.hpp>
#include <tribotwin/twin/live/commands.hpp>
#include <tribotwin/twin/live/row_files.hpp>

namespace tribotwin::twin::live {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t most_waiting_values = (64 << 20) / sizeof(double);

constexpr std::pair<std::string_view, McapMessages> message_kinds[] = {{"ros2", McapMessages::ros2},
                                                                       {"json", McapMessages::json}};

McapMessages read_messages(Mapping& keys) {
  return keys.has("messages") ? choice_of(keys, "messages", message_kinds) : McapMessages::ros2;
}

bool read_on(Mapping& keys) {
  if (!keys.has("on")) keys.fail("on", "is missing: true starts a recording, false ends it");
  return keys.flag_or("on", false);
}

/// "live-0012.5s.mcap: 100 rows, from 12.500 s to 12.599 s".
std::string words_of(const RowFile& file) {
  std::string words = fmt::format("{}: {} row{}", file.name, file.rows, file.rows == 1 ? "" : "s");
  if (file.rows > 0) words += fmt::format(", from {:.3f} s to {:.3f} s", file.from_s, file.to_s);
  if (file.lost_rows > 0) words += fmt::format("; {} are missing, which the way here had no room for", file.lost_rows);
  return words;
}

Result<void> write_mcap(LiveFile& file, const TelemetryOptions& head, McapMessages messages,
                        const RowMemory::Rows& rows) {
  McapRows mcap([&file](std::string_view bytes) { return file.write(bytes); }, head, messages);
  Result<void> written;
  const bool whole = rows.each([&](std::span<const double> row) {
    written = mcap.write(row[0], row.subspan(1));
    return written.has_value();
  });
  return whole ? mcap.finish() : written;
}

/// HDF5 serves one thread at a time. A session may write telemetry.h5 meanwhile: after each block it has its turn.
Result<void> write_hdf5(LiveFile& file, TelemetryOptions head, const RowMemory::Rows& rows) {
  constexpr auto longest_block = std::chrono::microseconds(200);
  head.wall_clock_s = [] { return 0.0; };  // blocks are written when they are full
  auto telemetry = Telemetry::create(file.partial(), std::move(head), Existing::replace);
  if (!telemetry) return tl::unexpected(telemetry.error());
  Result<void> written;
  const bool whole = rows.each([&](std::span<const double> row) {
    const auto begun = Clock::now();
    written = telemetry->append(row[0], row.subspan(1));
    const auto took = Clock::now() - begun;
    if (took > longest_block) std::this_thread::sleep_for(took);
    return written.has_value();
  });
  return whole ? telemetry->finish(false) : written;
}

}  // namespace

RowRecording::RowRecording(LiveFile file, const TelemetryOptions& head, McapMessages messages,
                           std::function<void(Result<void>)> ended)
    : file_(std::move(file)),
      head_(head),
      messages_(messages),
      ended_(std::move(ended)),
      so_far_{.name = file_.name()},
      width_(1 + head.joints.size() * head.channels.size()),
      thread_([this] { work(); }) {}

RowRecording::~RowRecording() {
  finish();
  thread_.join();
}

RowFile RowRecording::final() {
  so_far_.name = file_.name();
  return so_far_;
}

void RowRecording::add(std::uint64_t number, std::span<const double> row) {
  if (finishing_) return;
  if (so_far_.rows == 0) so_far_.from_s = row[0], next_ = number;
  so_far_.lost_rows += number - next_;
  next_ = number + 1;
  so_far_.to_s = row[0];
  ++so_far_.rows;
  batch_.insert(batch_.end(), row.begin(), row.end());
}

void RowRecording::send() {
  if (batch_.empty()) return;
  const std::size_t rows = batch_.size() / width_;
  {
    const std::lock_guard lock(mutex_);
    if (waiting_values_ + batch_.size() > most_waiting_values) {
      so_far_.rows -= rows;
      so_far_.lost_rows += rows;
      batch_.clear();
      return;
    }
    waiting_values_ += batch_.size();
    waiting_.push_back(std::move(batch_));
  }
  batch_ = {};
  changed_.notify_one();
}

void RowRecording::finish() {
  if (std::exchange(finishing_, true)) return;
  send();
  {
    const std::lock_guard lock(mutex_);
    no_more_ = true;
  }
  changed_.notify_one();
}

void RowRecording::work() {
  McapRows mcap([this](std::string_view bytes) { return file_.write(bytes); }, head_, messages_);
  Result<void> written;
  while (written) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return no_more_ || !waiting_.empty(); });
    if (waiting_.empty()) break;
    const std::vector<double> rows = std::move(waiting_.front());
    waiting_.pop_front();
    waiting_values_ -= rows.size();
    lock.unlock();
    for (std::size_t at = 0; written && at < rows.size(); at += width_)
      written = mcap.write(rows[at], std::span(rows).subspan(at + 1, width_ - 1));
  }
  if (written) written = mcap.finish();
  if (written) written = file_.publish();
  if (!written) file_.discard();
  ended_(written);
}

struct RowFiles::Export {
  LiveFile file;     // of the thread, but for its end
  std::string name;  // that it is to have
  RowMemory::Rows rows;
  Command command;
  double asked_min;
  Result<void> written = {};
  std::thread thread = {};
};

RowFiles::RowFiles(Options options, Ways ways)
    : options_(std::move(options)),
      ways_(std::move(ways)),
      memory_(1 + options_.head.joints.size() * options_.head.channels.size(), options_.memory_bytes) {}

RowFiles::~RowFiles() {
  if (exporting_) exporting_->thread.join();
}

void RowFiles::add(std::uint64_t number, std::span<const double> row) {
  time_s_ = row[0];
  memory_.add(number, row);
  if (recording_) recording_->add(number, row);
}

void RowFiles::send() {
  if (recording_) recording_->send();
}

const RowFile* RowFiles::recording() {
  return recording_ && !recording_->finishing() ? &recording_->so_far() : nullptr;
}

void RowFiles::end() {
  if (recording_) recording_->finish();
}

void RowFiles::tell_note(const std::string& text) { ways_.event({time_s_, "note", "", text}); }

void RowFiles::obey(const Command& command) {
  try {
    Mapping keys = keys_of(command);
    if (command.name == "record")
      record(command, keys);
    else
      export_rows(command, keys);
  } catch (const std::runtime_error& error) {  // also where no thread can be had
    ways_.done({command.viewer, command.id, false, error.what()});
  }
}

void RowFiles::record(const Command& command, Mapping& keys) {
  keys.accept({"on", "messages"});
  const bool on = read_on(keys);
  if (!on && keys.has("messages")) keys.fail("messages", "is said when a recording starts");
  const McapMessages messages = read_messages(keys);
  if (recording_ && recording_->finishing())
    throw InputError(fmt::format("record: {} is being closed; then again", recording_->so_far().name));
  if (on) return begin_recording(command, messages);
  if (!recording_) {
    const std::string failure = std::exchange(failure_, {});
    throw InputError(failure.empty() ? "record: nothing is recorded" : "record: " + failure);
  }
  stopped_by_ = command;
  recording_->finish();
}

void RowFiles::begin_recording(const Command& command, McapMessages messages) {
  if (recording_) throw InputError(fmt::format("record: {} is recorded already", recording_->so_far().name));
  LiveFile file =
      or_wrong_input(LiveFile::create(options_.folder, time_s_, "mcap", exporting_ ? exporting_->name : std::string()));
  const std::string name = file.name();
  failure_.clear();
  recording_ = std::make_unique<RowRecording>(
      std::move(file), options_.head, messages,
      [this](const Result<void>& written) { ways_.post([this, written] { recorded(written); }); });
  ways_.done({command.viewer, command.id, true, "recording " + name, recording_->so_far()});
  tell_note("recording " + name);
}

void RowFiles::recorded(const Result<void>& written) {
  const RowFile file = recording_->final();
  recording_.reset();
  const std::string words =
      written ? words_of(file)
              : fmt::format("{}; nothing is left of the recording of {} rows", written.error().message, file.rows);
  tell_note((written ? "recorded " : "") + words);
  if (stopped_by_) {
    ways_.done({stopped_by_->viewer, stopped_by_->id, written.has_value(), words, file});
    stopped_by_.reset();
  } else if (!written) {
    failure_ = words;
  }
}

void RowFiles::export_rows(const Command& command, Mapping& keys) {
  keys.accept({"minutes", "format", "messages"});
  const double minutes = keys.number("minutes", {1e-3, 1e6});
  const std::string format = keys.choice("format", {"h5", "mcap"});
  if (format == "h5" && keys.has("messages")) keys.fail("messages", "is said of the format mcap");
  const McapMessages messages = read_messages(keys);
  if (exporting_) throw InputError(fmt::format("export: {} is being written; then again", exporting_->name));
  if (memory_.empty()) throw InputError("export: there are no rows yet");
  LiveFile file = or_wrong_input(
      LiveFile::create(options_.folder, time_s_, format, recording_ ? recording_->so_far().name : std::string()));
  const std::string name = file.name();
  auto begun = std::make_unique<Export>(Export{std::move(file), name, memory_.last(60 * minutes), command, minutes});
  begun->thread = std::thread([this, format, messages, &one = *begun] {
    one.written = format == "h5" ? write_hdf5(one.file, options_.head, one.rows)
                                 : write_mcap(one.file, options_.head, messages, one.rows);
    if (one.written) one.written = one.file.publish();
    if (!one.written) one.written = tl::unexpected(one.file.without_path(one.written.error()));
    if (!one.written) one.file.discard();
    ways_.post([this] { exported(); });
  });
  exporting_ = std::move(begun);
}

void RowFiles::exported() {
  exporting_->thread.join();
  const std::unique_ptr<Export> one = std::move(exporting_);
  const RowMemory::Rows& rows = one->rows;
  const RowFile file{one->file.name(), rows.size(), rows.missing(), rows.first_s(), rows.last_s()};
  std::string words = one->written ? words_of(file) : one->written.error().message + "; nothing is left of it";
  if (one->written)
    words += fmt::format(", {:.3g} of {:.3g} min asked for", (file.to_s - file.from_s) / 60, one->asked_min);
  ways_.done({one->command.viewer, one->command.id, one->written.has_value(), words, file});
  tell_note((one->written ? "exported " : "") + words);
}

}  // namespace tribotwin::twin::live
