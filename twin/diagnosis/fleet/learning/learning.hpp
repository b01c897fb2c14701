#pragma once

#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/store.hpp>
#include <tribotwin/twin/numerics/executor/manager.hpp>

/// The models of all types of a fleet, each learned in a process of its own, on any rank of a job.
namespace tribotwin::twin::diagnosis::fleet {

/// A type whose model could not be learned: a crash or an exception. Also a note of the store, until it succeeds; a
/// model that the store had before stays.
struct FailedModel {
  std::string type, joint;  ///< type of robot, name of the joint
  std::string input;        ///< "560 curves of 40 robots"
  TaskFailure failure;
};
struct Learned {
  std::vector<TypeModel> models;   ///< by type and joint
  std::vector<std::string> notes;  ///< which have too few curves
  std::vector<FailedModel> failed;
};

struct LearningOptions {
  unsigned threads = 0;  ///< 0: all cores
  int retries = 1;       ///< further attempts of a type whose model failed
};
/// At most so many curves of a type take part. Of more, every second robot does, or every fourth, ..
constexpr std::size_t curves_of_type = 200'000;

/// Learns a model per type of robot and joint from all healthy observations and keeps it. Collective: `store` is null
/// on all ranks but the first, where the result is empty. InputError where there is nothing that can be learned from;
/// otherwise throws as Store does.
Learned learn_fleet(Store* store, const LearningOptions& options);

}  // namespace tribotwin::twin::diagnosis::fleet
