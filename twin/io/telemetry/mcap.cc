#include <algorithm>
#include <cmath>
#include <memory>
#include <optional>

#include <tribotwin/twin/io/mcap/joint_json.hpp>
#include <tribotwin/twin/io/mcap/joint_states.hpp>
#include <tribotwin/twin/io/mcap/writer.hpp>
#include <tribotwin/twin/io/telemetry/mcap_rows.hpp>
#include <tribotwin/twin/io/telemetry/reader.hpp>

namespace tribotwin::twin {

using namespace hdf5;

namespace {

/// The channels that a JointState has fields for, in their order.
constexpr std::string_view joint_state_channels[] = {"position_rad", "velocity_rad_s", "torque_nm"};

std::int64_t ns_of(double time_s) {
  constexpr double last_s = 2147483647;  // of a ROS stamp
  if (!(time_s >= 0 && time_s <= last_s))
    throw Failure(fmt::format("time {} s is outside 0 .. {} s, which stamps can hold", time_s, last_s));
  return std::llround(time_s * 1e9);
}

/// The rows of one table as messages of its topics.
class Topics {
 public:
  Topics(mcap::Writer& writer, const Recording& head, const std::vector<Channel>& channels)
      : writer_(writer), joints_(head.joints), channels_(channels.size()) {
    for (std::size_t c = 0; c < channels.size(); ++c) {
      const auto* const field = std::ranges::find(joint_state_channels, channels[c].name);
      if (field != std::end(joint_state_channels))
        fields_[static_cast<std::size_t>(field - joint_state_channels)] = c;
      else
        interfaces_.push_back(channels[c].name), interface_places_.push_back(c);
    }
  }

  void add_joint_states(const std::string& topic) { joint_states_ = add_topic(mcap::JointMessage::joint_state, topic); }
  void add_dynamic_joint_states(const std::string& topic) {
    if (!interfaces_.empty()) dynamic_joint_states_ = add_topic(mcap::JointMessage::dynamic_joint_state, topic);
  }

  Status write(double time_s, std::span<const double> row) {
    const std::int64_t ns = ns_of(time_s);
    if (joint_states_) {
      for (std::size_t f = 0; f < std::size(fields_); ++f) take(row, fields_[f], numbers_[f]);
      const auto message = mcap::encode_joint_state(ns, joints_, numbers_[0], numbers_[1], numbers_[2]);
      if (auto ok = writer_.add_message(joint_states_, static_cast<std::uint64_t>(ns), message); !ok) return ok;
    }
    if (!dynamic_joint_states_) return {};
    values_.clear();
    for (std::size_t j = 0; j < joints_.size(); ++j)
      for (const auto c : interface_places_) values_.push_back(row[j * channels_ + c]);
    return writer_.add_message(dynamic_joint_states_, static_cast<std::uint64_t>(ns),
                               mcap::encode_dynamic_joint_state(ns, joints_, interfaces_, values_));
  }

 private:
  std::uint16_t add_topic(mcap::JointMessage kind, const std::string& topic) {
    const auto schema = writer_.add_schema(mcap::type_name(kind), "ros2msg", mcap::definition(kind));
    return writer_.add_channel(topic, "cdr", schema);
  }
  void take(std::span<const double> row, std::optional<std::size_t> channel, std::vector<double>& out) const {
    out.clear();
    for (std::size_t j = 0; j < joints_.size() && channel; ++j) out.push_back(row[j * channels_ + *channel]);
  }

  mcap::Writer& writer_;
  const std::vector<std::string>& joints_;
  std::size_t channels_;
  std::optional<std::size_t> fields_[std::size(joint_state_channels)];
  std::vector<std::string> interfaces_;
  std::vector<std::size_t> interface_places_;
  std::uint16_t joint_states_ = 0, dynamic_joint_states_ = 0;  // 0: there is none
  std::vector<double> numbers_[std::size(joint_state_channels)], values_;
};

/// The rows of one table as JSON, one topic per joint.
class JsonTopics {
 public:
  /// `units`: of each joint, where they have others than `channels` says.
  JsonTopics(mcap::Writer& writer, const Recording& head, const std::vector<Channel>& channels,
             const std::vector<std::vector<std::string>>& units, std::string_view prefix)
      : writer_(writer), width_(channels.size()) {
    std::string first;
    for (std::size_t j = 0; j < head.joints.size(); ++j) {
      std::vector<mcap::Quantity> quantities;
      for (std::size_t c = 0; c < width_; ++c) {
        const std::string& unit = units.empty() ? channels[c].unit : units[j][c];
        quantities.push_back({column_name(channels[c].name, unit), unit, channels[c].description});
      }
      joints_.emplace_back(std::move(quantities));
      const std::string schema = joints_.back().schema();
      if (j == 0) first = schema;
      const auto number =
          writer_.add_schema(mcap::joint_schema_name(head.joints[j], schema, first), "jsonschema", schema);
      numbers_.push_back(writer_.add_channel(std::string(prefix) + mcap::joint_topic(head.joints[j]), "json", number));
    }
  }

  Status write(double time_s, std::span<const double> row) {
    const auto ns = static_cast<std::uint64_t>(ns_of(time_s));
    for (std::size_t j = 0; j < joints_.size(); ++j) {
      text_.clear();
      joints_[j].append(text_, time_s, row.subspan(j * width_, width_));
      if (auto ok = writer_.add_message(numbers_[j], ns, text_); !ok) return ok;
    }
    return {};
  }

 private:
  mcap::Writer& writer_;
  std::size_t width_;
  std::vector<mcap::JointJson> joints_;
  std::vector<std::uint16_t> numbers_;
  std::string text_;
};

template <class Topics>
Status write_rows(const Reader& r, const Columns& columns, Topics& topics,
                  const std::function<void(double)>& progress) {
  Rows rows(r, columns, rows_at_once);
  std::vector<double> row;
  for (hsize_t from = 0; from < columns.rows; from += rows_at_once) {
    const std::size_t count = std::min<hsize_t>(rows_at_once, columns.rows - from);
    {
      const Hdf5 hdf5;
      rows.read(from, count);
    }
    for (std::size_t i = 0; i < count; ++i) {
      rows.get(i, row);
      if (auto ok = topics.write(rows.time_s(i), row); !ok) return ok;
    }
    if (progress) progress(static_cast<double>(from + count) / static_cast<double>(columns.rows));
  }
  return {};
}

/// What the record says of the run and of each joint.
mcap::Texts metadata_of(const Recording& head) {
  mcap::Texts out(head.attributes.begin(), head.attributes.end());
  out.emplace_back("complete", head.complete ? "1" : "0");
  for (std::size_t j = 0; j < head.joints.size(); ++j)
    for (const auto& [name, value] : head.joint_attributes[j])
      out.emplace_back(fmt::format("{}.{}", head.joints[j], name), fmt::format("{}", value));
  return out;
}

template <class Topics>
Status write_tables(const Reader& r, Topics& samples, Topics& cycles, const std::function<void(double)>& progress) {
  if (auto ok = write_rows(r, r.samples, samples, progress); !ok) return ok;
  return r.cycles.rows > 0 ? write_rows(r, r.cycles, cycles, {}) : Status{};
}

Topics sample_topics(mcap::Writer& writer, const Recording& head) {
  Topics samples(writer, head, head.channels);
  samples.add_joint_states("/joint_states");
  samples.add_dynamic_joint_states("/dynamic_joint_states");
  return samples;
}
JsonTopics json_sample_topics(mcap::Writer& writer, const Recording& head) {
  return {writer, head, head.channels, head.units, ""};
}

Status write_ros2(mcap::Writer& writer, const Reader& r, const std::function<void(double)>& progress) {
  Topics samples = sample_topics(writer, r.head), cycles(writer, r.head, r.head.cycle_channels);
  if (r.cycles.rows > 0) cycles.add_dynamic_joint_states("/cycle_states");
  return write_tables(r, samples, cycles, progress);
}

Status write_json(mcap::Writer& writer, const Reader& r, const std::function<void(double)>& progress) {
  JsonTopics samples = json_sample_topics(writer, r.head);
  if (r.cycles.rows == 0) return write_rows(r, r.samples, samples, progress);
  JsonTopics cycles(writer, r.head, r.head.cycle_channels, {}, "/cycles");
  return write_tables(r, samples, cycles, progress);
}

mcap::Writer begun(mcap::Writer::Sink sink, const Recording& head, McapMessages messages) {
  mcap::Writer writer(std::move(sink), messages == McapMessages::json ? "" : "ros2", "tribotwin");
  writer.add_metadata("tribotwin", metadata_of(head));
  return writer;
}

Status write_mcap(NewFile& out, const Reader& r, McapMessages messages, const std::function<void(double)>& progress) {
  mcap::Writer writer = begun([&](std::string_view bytes) { return out.write(bytes); }, r.head, messages);
  const bool json = messages == McapMessages::json;
  if (auto ok = (json ? write_json : write_ros2)(writer, r, progress); !ok) return ok;
  return writer.finish();
}

/// The head that a telemetry.h5 with these options has while it grows.
Recording head_of(const TelemetryOptions& o) {
  Recording head{.attributes = o.attributes,
                 .joints = o.joints,
                 .joint_attributes = o.joint_attributes,
                 .channels = o.channels,
                 .units = o.units};
  head.joint_attributes.resize(o.joints.size());
  return head;
}

}  // namespace

struct McapRows::Impl {
  using Write = std::function<Status(double time_s, std::span<const double> row)>;
  Recording head;
  mcap::Writer writer;
  Write write;

  Impl(mcap::Writer::Sink sink, Recording of, McapMessages messages)
      : head(std::move(of)),
        writer(begun(std::move(sink), head, messages)),
        write(messages == McapMessages::json ? through(json_sample_topics(writer, head))
                                             : through(sample_topics(writer, head))) {}

  template <class Topics>
  static Write through(Topics topics) {
    return [topics = std::make_shared<Topics>(std::move(topics))](double time_s, std::span<const double> row) {
      return topics->write(time_s, row);
    };
  }
};

McapRows::McapRows(std::function<Status(std::string_view)> sink, const TelemetryOptions& options, McapMessages messages)
    : impl_(std::make_unique<Impl>(std::move(sink), head_of(options), messages)) {}
McapRows::McapRows(McapRows&&) noexcept = default;
McapRows::~McapRows() = default;

Status McapRows::write(double time_s, std::span<const double> row) try {
  return impl_->write(time_s, row);
} catch (const Failure& failure) {
  return work_failed(failure.what());
}

Status McapRows::finish() { return impl_->writer.finish(); }

Result<void> export_mcap(const fs::path& run_dir, const fs::path& file, Existing existing, McapMessages messages,
                         const std::function<void(double)>& progress) {
  const fs::path path = run_dir / "telemetry.h5";
  if (auto ok = probe(path); !ok) return ok;
  const auto r = guarded(path, no_record, [&] {
    const Hdf5 hdf5;
    return open_record(path);
  });
  if (!r) return tl::unexpected(r.error());
  auto out = NewFile::create(file, existing);
  if (!out) return tl::unexpected(out.error());
  const auto written = guarded(path, no_record, [&] { return write_mcap(*out, *r, messages, progress); });
  if (!written) return tl::unexpected(written.error());
  return *written ? out->publish() : *written;
}

}  // namespace tribotwin::twin
