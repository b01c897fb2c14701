#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/fleet/reader.hpp>
#include <tribotwin/twin/diagnosis/fleet/store.hpp>
#include <tribotwin/twin/numerics/executor/manager.hpp>

/// The work of `tribotwin fleet`: import, and verdicts on all joints. Memory holds a chunk of curves
/// and some hundred bytes per joint. Functions throw as Store does; those with a pointer to the store are collective:
/// it is null on all ranks but the first, where their results are empty.
namespace tribotwin::twin::diagnosis::fleet {

struct ImportOptions {
  ReaderOptions read;
  double load_sensitivity = 0.6;  ///< as in ObservationOptions
  unsigned threads = 0;           ///< 0: all cores
  bool learned = false;           ///< the curves are of healthy joints
  bool replace = false;           ///< a curve that has changed takes the place of the one in the store
  int retries = 1;                ///< further attempts of a curve whose fit failed
};
/// A curve that could not be fitted, or a joint that could not be judged or explained: a crash or an exception. Also a
/// note of the store, until it succeeds.
struct FailedPart {
  Key key;            ///< of a joint with the day that was judged
  std::string input;  ///< "FILE:LINE" of a curve, the number of curves of a joint
  TaskFailure failure;
};
struct Imported {
  std::size_t curves = 0, added = 0, known = 0, promoted = 0, replaced = 0, weak = 0;
  std::string first_weak;  ///< "FILE:LINE: Fs, Vs"
  std::vector<FailedPart> failed;
};
/// Adds all curves of `data`. InputError, with both places, where a curve differs from the one that is in the store.
Imported import_curves(Store* store, const std::filesystem::path& data, const ImportOptions& options);

struct SurveyOptions {
  double rate = 0.05;                  ///< share of the listed joints that may be healthy, on average
  double days = 10;                    ///< of the window of `check`
  std::optional<std::int64_t> time_s;  ///< end of the window; default: the newest observation
  double load_sensitivity = 0.6;
  unsigned threads = 0;  ///< 0: all cores
  int retries = 1;       ///< further attempts of a joint whose judgement failed
};
struct Listed {
  JointName joint;
  double p = 1, q = 1;
  std::size_t observations = 0;  ///< in the window, or of the chart
  Finding finding;
  double rank = 0;   ///< larger of the severity, where it is relative, and the share of the margin used
  double cusum = 0;  ///< of `watch`, larger of both regions
  std::optional<std::int64_t> since_s;  ///< of `watch`: first day on which the joint was listed
};
struct Survey {
  std::int64_t time_s = 0;
  std::size_t judged = 0, without_model = 0, without_temperature = 0;
  std::vector<Listed> listed;  ///< by falling rank
  std::vector<FailedPart> failed;
};
/// One test per joint over its observations of the last days; the listed ones by Benjamini and Hochberg.
Survey check_fleet(Store* store, const SurveyOptions& options);
/// One CUSUM per joint over all its observations that were not learned from; listed ones by Benjamini and Hochberg over
/// the probabilities that healthy joints come as far.
Survey watch_fleet(Store* store, const SurveyOptions& options);
/// "0.5 joints or fewer are healthy on average ..": how many of a list of so many, made at a false-discovery rate.
std::string healthy_among(std::size_t listed, double rate);

}  // namespace tribotwin::twin::diagnosis::fleet
