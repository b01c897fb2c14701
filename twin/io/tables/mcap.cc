#include <algorithm>
#include <map>
#include <numeric>

#include <fmt/format.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/io/mcap/joint_states.hpp>
#include <tribotwin/twin/io/tables/source.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::tables {
namespace {

namespace fs = std::filesystem;
using Status = Result<void>;
using Names = std::vector<std::string>;

tl::unexpected<Error> wrong(std::string what) { return tl::unexpected(Error(std::move(what))); }

constexpr std::uint64_t latest_ns = 4'000'000'000'000'000'000;  // differences of times do not overflow

/// All messages of one topic, as columns: most messages have a number for each, but they need not.
class Topic {
 public:
  struct Column {
    std::string joint, interface;
    std::vector<std::uint32_t> rows;  ///< messages that have a number
    std::vector<double> values;       ///< theirs
  };

  explicit Topic(mcap::JointMessage kind) : kind_(kind) {}

  Status add(const mcap::Channel& channel, std::uint64_t log_time_ns, std::string_view data) {
    if (const auto ok = mcap::decode(channel, data, message_); !ok)
      return wrong(fmt::format("message {} of {} {}", log_ns_.size() + 1, shown(channel.topic), ok.error().message));
    if (log_time_ns > latest_ns)
      return wrong(fmt::format("message {} of {} has the log_time {} ns; times until {} ns are read",
                               log_ns_.size() + 1, shown(channel.topic), log_time_ns, latest_ns));
    constexpr std::size_t most_values = limits::array_bytes / sizeof(double) / 2;
    values_ += message_.values.size() + 1;
    if (values_ > most_values) return wrong(fmt::format("{} holds more numbers than are read", shown(channel.topic)));
    const auto row = static_cast<std::uint32_t>(log_ns_.size());
    for (std::size_t k = 0; k < message_.values.size(); ++k) {
      Column& column = columns_[place_of(k, message_.values[k])];
      if (!column.rows.empty() && column.rows.back() == row)
        return wrong(fmt::format("message {} of {} has {} of {} twice", row + 1, shown(channel.topic),
                                 shown(column.interface), shown(column.joint)));
      column.rows.push_back(row), column.values.push_back(message_.values[k].value);
    }
    log_ns_.push_back(log_time_ns), stamp_ns_.push_back(message_.stamp_ns);
    return {};
  }

  mcap::JointMessage kind() const { return kind_; }
  std::size_t size() const { return log_ns_.size(); }
  std::vector<Column>& columns() { return columns_; }
  const std::vector<std::uint64_t>& log_ns() const { return log_ns_; }
  const std::vector<std::int64_t>& stamp_ns() const { return stamp_ns_; }
  bool has(const std::string& joint, const std::string& interface) const {
    return places_.contains({joint, interface});
  }

 private:
  /// The column of the k-th number of a message: mostly the same as in the message before.
  std::size_t place_of(std::size_t k, const mcap::JointNumbers::Value& value) {
    if (k < order_.size() && columns_[order_[k]].joint == value.joint &&
        columns_[order_[k]].interface == value.interface)
      return order_[k];
    const auto [known, added] =
        places_.try_emplace({std::string(value.joint), std::string(value.interface)}, columns_.size());
    if (added)
      columns_.push_back({.joint = known->first.first, .interface = known->first.second, .rows = {}, .values = {}});
    if (k >= order_.size()) order_.resize(k + 1, known->second);
    return order_[k] = known->second;
  }

  mcap::JointMessage kind_;
  std::size_t values_ = 0;
  std::vector<std::uint64_t> log_ns_;
  std::vector<std::int64_t> stamp_ns_;
  std::vector<Column> columns_;
  std::map<std::pair<std::string, std::string>, std::size_t> places_;
  std::vector<std::size_t> order_;  // columns of the numbers of the message before
  mcap::JointNumbers message_;
};

struct Topics {
  std::map<std::string, Topic> of_joints;
  Names others;
  std::string cut_off;
};

Result<Topics> read_topics(const fs::path& file) {
  Topics out;
  const auto contents = mcap::read(file, [&](const mcap::Channel& channel, std::uint64_t log_time_ns, auto data) {
    const auto kind = mcap::joint_message_of(channel);
    return kind ? out.of_joints.try_emplace(channel.topic, *kind).first->second.add(channel, log_time_ns, data)
                : Status{};
  });
  if (!contents) return tl::unexpected(contents.error());
  for (const auto& channel : contents->channels)
    if (!out.of_joints.contains(channel.topic))
      out.others.push_back(channel.schema.empty() ? channel.topic : channel.topic + " of " + channel.schema);
  out.cut_off = contents->cut_off;
  return out;
}

Names names_of(const Topics& topics, mcap::JointMessage kind) {
  Names names;
  for (const auto& [name, topic] : topics.of_joints)
    if (topic.kind() == kind) names.push_back(name);
  return names;
}

/// The topic that was asked for, or the only one: of JointState or, where there is none, of DynamicJointState.
Result<std::string> choose_topic(const fs::path& file, const Topics& topics, const std::string& asked) {
  Names names = names_of(topics, mcap::JointMessage::joint_state);
  if (!asked.empty()) {
    for (const auto& name : names_of(topics, mcap::JointMessage::dynamic_joint_state)) names.push_back(name);
    if (topics.of_joints.contains(asked)) return asked;
    return wrong(fmt::format("{}: --topic {}: its topics of joints are {}", file.string(), shown(asked), shown(names)));
  }
  if (names.empty()) names = names_of(topics, mcap::JointMessage::dynamic_joint_state);
  if (names.size() == 1) return names.front();
  if (names.empty())
    return wrong(fmt::format("{}: holds no messages of {} or {}; its topics are {}", file.string(),
                             mcap::type_name(mcap::JointMessage::joint_state),
                             mcap::type_name(mcap::JointMessage::dynamic_joint_state),
                             topics.others.empty() ? "none" : shown(topics.others)));
  return wrong(fmt::format("{}: has joints on the topics {}; --topic says which", file.string(), shown(names)));
}

/// What ROS means by the three numbers of a JointState: of a hinge, and of a slide.
struct Meaning {
  std::string_view interface, quantity, hinge, slide;
};
constexpr Meaning meanings[] = {
    {"position", "position", "rad", "m"}, {"velocity", "velocity", "rad_s", "m_s"}, {"effort", "torque", "nm", "n"}};

/// A message does not say whether a joint turns or slides. Who wants metres of it knows that it slides.
bool slides(const std::string& joint, const Names& wanted) {
  return std::ranges::any_of(meanings, [&](const Meaning& m) {
    return std::ranges::find(wanted, fmt::format("{}_{}_{}", m.quantity, joint, m.slide)) != wanted.end();
  });
}

std::string header_of(const Topic::Column& column, const Names& wanted) {
  const auto* const m = std::ranges::find(meanings, column.interface, &Meaning::interface);
  if (m == std::end(meanings)) return fmt::format("{}.{}", column.joint, column.interface);
  return fmt::format("{}.{}_{}", column.joint, m->quantity, slides(column.joint, wanted) ? m->slide : m->hinge);
}

/// Which row of a topic has which stamp, for numbers of another topic with the same stamps.
using RowOfStamp = std::map<std::int64_t, std::uint32_t>;

/// A topic of joints as a table: time_s and JOINT.QUANTITY_UNIT, one row per message in the order of their log times.
class McapSource final : public ArraySource {
 public:
  McapSource(std::string name, Topic topic, std::string cut_off)
      : name_(std::move(name)), topic_(std::move(topic)), cut_off_(std::move(cut_off)), headers_{"time_s"} {
    by_time_.resize(topic_.size());
    std::iota(by_time_.begin(), by_time_.end(), 0u);
    std::ranges::stable_sort(by_time_, {}, [&](std::uint32_t row) { return topic_.log_ns()[row]; });
  }

  void add_columns(const Names& wanted) {
    for (auto& column : topic_.columns()) add(std::move(column), wanted);
  }
  /// Numbers that a companion topic has of the same instants, such as temperatures.
  void add_companion(Topic& companion, const Names& wanted) {
    RowOfStamp row_of;
    for (std::uint32_t row = 0; row < topic_.size(); ++row) row_of.emplace(topic_.stamp_ns()[row], row);
    for (const auto& column : companion.columns()) {
      if (topic_.has(column.joint, column.interface)) continue;
      Topic::Column here{.joint = column.joint, .interface = column.interface, .rows = {}, .values = {}};
      for (std::size_t k = 0; k < column.rows.size(); ++k)
        if (const auto row = row_of.find(companion.stamp_ns()[column.rows[k]]); row != row_of.end())
          here.rows.push_back(row->second), here.values.push_back(column.values[k]);
      if (!here.rows.empty()) add(std::move(here), wanted);
    }
  }

  const std::vector<std::string>& headers() const override { return headers_; }

  Status read(std::span<const Pick> picks, Numbers& numbers) override {
    choose_rows(picks);
    choose_time(numbers.file.string());
    numbers.notes = notes_;
    return ArraySource::read(picks, numbers);
  }

 private:
  static constexpr std::uint32_t none = static_cast<std::uint32_t>(-1);

  void add(Topic::Column column, const Names& wanted) {
    headers_.push_back(header_of(column, wanted));
    columns_.push_back(std::move(column));
  }

  /// The messages with any of the picked numbers: a topic may have several publishers, each with its own joints.
  void choose_rows(std::span<const Pick> picks) {
    std::vector<bool> used(topic_.size(), false);
    bool any = false;
    for (const Pick& pick : picks) {
      if (pick.rate_hz > 0 || pick.header == 0) continue;
      any = true;
      for (const auto row : columns_[pick.header - 1].rows) used[row] = true;
    }
    place_.assign(topic_.size(), none);
    rows_ = 0;
    for (const auto row : by_time_)
      if (!any || used[row]) place_[row] = rows_++;
  }

  /// The stamps of the headers where they rise, else the log times.
  void choose_time(const std::string& file) {
    time_ns_.assign(rows_, 0);
    bool stamped = false;
    for (std::uint32_t row = 0; row < place_.size(); ++row)
      if (place_[row] != none) time_ns_[place_[row]] = topic_.stamp_ns()[row], stamped |= topic_.stamp_ns()[row] != 0;
    const bool rises = std::ranges::adjacent_find(time_ns_, std::greater_equal{}) == time_ns_.end();
    if (!(stamped && rises))
      for (std::uint32_t row = 0; row < place_.size(); ++row)
        if (place_[row] != none) time_ns_[place_[row]] = static_cast<std::int64_t>(topic_.log_ns()[row]);
    // Doubles of seconds since 1970 resolve 0.2 us only.
    constexpr std::int64_t second = 1'000'000'000, far = 1'000'000 * second;
    start_ns_ = rows_ && (time_ns_[0] > far || time_ns_[0] < -far) ? time_ns_[0] / second * second : 0;
    notes_.clear();
    notes_.push_back(fmt::format("{}: topic {}, {} messages; time is {}{}", file, shown(name_), rows_,
                                 stamped && rises ? "header.stamp"
                                 : stamped        ? "log_time, because header.stamp does not rise"
                                                  : "log_time, because header.stamp is not set",
                                 start_ns_ ? fmt::format(", from {} s on", start_ns_ / second) : ""));
    if (!cut_off_.empty())
      notes_.push_back(
          fmt::format("{}: IS CUT OFF: it {}; what its recorder had not yet written is missing", file, cut_off_));
  }

  Result<std::vector<double>> column(std::size_t header) override {
    std::vector<double> out(rows_, std::numeric_limits<double>::quiet_NaN());
    if (header == 0) {
      std::ranges::transform(time_ns_, out.begin(),
                             [&](std::int64_t ns) { return static_cast<double>(ns - start_ns_) / 1e9; });
      return out;
    }
    const auto& column = columns_[header - 1];
    for (std::size_t k = 0; k < column.rows.size(); ++k)
      if (const auto place = place_[column.rows[k]]; place != none) out[place] = column.values[k];
    return out;
  }

  std::string name_;
  Topic topic_;
  std::string cut_off_;
  std::vector<std::string> headers_, notes_;
  std::vector<Topic::Column> columns_;
  std::vector<std::uint32_t> by_time_;  // messages by their log time
  std::vector<std::uint32_t> place_;    // of each message in the table; none: not wanted
  std::uint32_t rows_ = 0;
  std::vector<std::int64_t> time_ns_;  // of each row
  std::int64_t start_ns_ = 0;          // what is 0 s
};

/// As ros2_control names the two topics of a joint_state_broadcaster, in any namespace.
std::string companion_of(const std::string& topic) {
  return topic.substr(0, topic.rfind('/') + 1) + "dynamic_joint_states";
}

}  // namespace

Opened open_mcap(const fs::path& file, const Names& wanted, const std::string& topic) {
  auto topics = read_topics(file);
  if (!topics) return tl::unexpected(topics.error());
  const auto name = choose_topic(file, *topics, topic);
  if (!name) return tl::unexpected(name.error());
  auto chosen = topics->of_joints.extract(*name);
  const bool has_companion = chosen.mapped().kind() == mcap::JointMessage::joint_state;
  auto source = std::make_unique<McapSource>(*name, std::move(chosen.mapped()), topics->cut_off);
  source->add_columns(wanted);
  if (const auto companion = topics->of_joints.find(companion_of(*name));
      has_companion && companion != topics->of_joints.end())
    source->add_companion(companion->second, wanted);
  return source;
}

}  // namespace tribotwin::twin::tables
