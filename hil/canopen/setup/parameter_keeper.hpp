#pragma once

#include <functional>

#include <tribotwin/hil/canopen/node_context.hpp>
#include <tribotwin/hil/canopen/setup/object_values.hpp>

namespace tribotwin::hil {

/// Stores and restores parameters (CiA 301, 7.5.2.13 and 7.5.2.14): "save" to 1010h keeps those of an area that differ
/// from their defaults, "load" to 1011h forgets them. The values hold from the next reset on.
///
/// Parameters are the objects that can be written, but not by an RPDO: what is mapped are commands, save 6060h and
/// 6072h.
class ParameterKeeper {
 public:
  /// Keeps the parameters for the next start; false: that failed.
  using Keep = std::function<bool(const KeptParameters&)>;

  /// Without `keep` the drive has no memory.
  ParameterKeeper(NodeContext& node, KeptParameters kept, Keep keep);

  static bool owns(std::uint16_t index);
  /// Whether this is a command that the drive knows: the signature of the object, 1010h or 1011h, and a memory.
  tl::expected<void, Abort> may_obey(const Object& object, std::int64_t signature) const;
  /// Carries it out before it is written, because only then it can be refused. `defaults`: the objects after a reset
  /// without anything kept.
  tl::expected<void, Abort> obey(const Object& object, const Dictionary& defaults);
  /// The object shows again what it can do.
  void show();
  bool keep_number(std::uint8_t number);
  bool can_keep() const { return static_cast<bool>(keep_); }
  const KeptParameters& kept() const { return kept_; }

 private:
  bool change(KeptParameters next);

  NodeContext& node_;
  KeptParameters kept_;
  Keep keep_;
};

}  // namespace tribotwin::hil
