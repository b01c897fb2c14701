#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include <tribotwin/plugins/mujoco/loader.hpp>

/// Detects whether stored results still match the current inputs. Not for security.
namespace tribotwin::twin {

/// FNV-1a over everything added (64 bit, http://www.isthe.com/chongo/tech/comp/fnv).
class Fingerprint {
 public:
  void add(std::string_view bytes);
  void add(std::span<const double> values);
  std::uint64_t value() const { return hash_; }

 private:
  std::uint64_t hash_ = 14695981039346656037ULL;
};

/// What a simulated motion of a model depends on: its drives' keys, bodies, joints and solver settings.
std::uint64_t fingerprint(const mujoco::Model& model);

}  // namespace tribotwin::twin
