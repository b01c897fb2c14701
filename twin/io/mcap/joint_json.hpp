#pragma once

#include <span>
#include <string>
#include <string_view>
#include <vector>

/// The row of a joint as JSON with a schema: what the live bench sends and what `export --mcap --messages json` writes.
namespace tribotwin::twin::mcap {

/// One number of each message.
struct Quantity {
  std::string name, unit, description;
};

/// {"time_s":0.25,"position_rad":0.1,..}
class JointJson {
 public:
  explicit JointJson(std::vector<Quantity> quantities);
  /// As JSON Schema, draft 2020-12, of an object whose numbers may be null.
  std::string schema() const;
  /// `values` as the quantities. Each double in its shortest exact form, with a point or an exponent; those that are
  /// not finite are null, which JSON has instead.
  void append(std::string& out, double time_s, std::span<const double> values) const;

 private:
  std::vector<Quantity> quantities_;
  std::vector<std::string> heads_;  // `,"position_rad":`
};

/// Topics: joint "j2" is "/joints/j2".
std::string joint_topic(std::string_view joint);

/// Of the schema of a joint's messages; `first` is that of the first joint: who has the same schema has the same name.
std::string joint_schema_name(std::string_view joint, std::string_view schema, std::string_view first);

}  // namespace tribotwin::twin::mcap
