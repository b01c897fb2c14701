#pragma once

#include <memory>
#include <string>
#include <vector>

#include <tribotwin/twin/diagnosis/fleet/judge.hpp>
#include <tribotwin/twin/diagnosis/fleet/level_curve.hpp>

/// What is known of a fleet, in one file or database: robots, observations, models, verdicts, notes. All of a session
/// or nothing of it is kept, whatever happens. Throws InputError where the file is no store, std::runtime_error where
/// the machine fails. Nothing outside of database/ knows which database it is.
namespace tribotwin::twin::diagnosis::fleet {

/// An observation as it is kept.
struct Entry {
  Key key;
  std::string file;
  std::size_t line = 0;
  std::uint32_t checksum = 0;
  Observation observation;
};

struct JointName {
  std::int64_t id = 0;
  std::string type, robot, joint;
};

/// One line of a check or a watch.
struct StoredVerdict {
  std::int64_t joint = 0;
  double p = 1, q = 1;
  std::string pattern, unit;
  double severity = 0, confidence = 0, margin = 0;
};

/// How often and how strictly joints were judged before.
struct PastCheck {
  std::string kind;  ///< check, watch
  std::int64_t time_s = 0;
  double rate = 0;
  std::size_t judged = 0, listed = 0;
};
/// Where curves of a time came from.
struct ImportedFile {
  std::string name;
  std::size_t curves = 0, weak = 0, robots = 0;  ///< weak: left out, not identifiable from their levels
};
struct StoredNote {
  std::string robot, joint, text;
  std::int64_t time_s = 0;
};

class Store {
 public:
  /// Opens a store, or makes one where there is no file of that name, or no tables in the database of that URL; nothing
  /// is kept before commit().
  explicit Store(const std::string& name);
  Store(const Store&) = delete;
  /// As it may be printed: without a password.
  const std::string& name() const { return name_; }
  ~Store();  ///< without commit(): all is as before, and a new file is gone

  enum class Put { added, known, promoted, replaced, changed };
  /// What put() would do; does not look at the features.
  Put look(const Entry& entry, bool learned);
  /// Keeps the entry. One of the same key and checksum stays as it is, but is learned from then on if `learned`
  /// (promoted); one of another checksum stays too (changed) unless `replace`.
  Put put(const Entry& entry, bool learned, bool replace);
  /// Where the entry of that key came from: "FILE:LINE".
  std::string origin(const Key& key);

  /// All joints by type, name and robot.
  std::vector<JointName> joints();
  /// The identifiable observations of a joint by time; `learned`: healthy ones, else the others, from `from_s` to
  /// `to_s`, both included.
  Rows rows(std::int64_t joint, bool learned, std::int64_t from_s, std::int64_t to_s);
  /// Time of the newest observation that was not learned from; nothing without any.
  std::optional<std::int64_t> newest();

  /// In place of an earlier one, and of a note that it failed.
  void put_model(const TypeModel& model);
  /// A note that learning the model of a type's joint has failed, in place of an earlier one.
  void put_failed_model(const std::string& type, const std::string& joint, const std::string& text);
  std::vector<std::string> model_texts();  ///< for from_text()
  /// The verdicts of one day; those of the same day and kind are replaced.
  void put_verdicts(const std::string& kind, std::int64_t time_s, double rate, std::size_t judged,
                    const std::vector<StoredVerdict>& verdicts);
  /// A note that `work` on that curve (`fit`), or on that joint (`check`, `watch` of that day), has failed. It goes
  /// with put() of that curve, and with put_verdicts() of that day.
  void put_failure(const std::string& work, const Key& key, const std::string& text);
  void commit();

  /// For reports. Times: of the curves, both ends included.
  std::vector<PastCheck> checks();
  std::vector<ImportedFile> files(std::int64_t from_s, std::int64_t to_s);
  std::vector<StoredNote> notes(std::int64_t from_s, std::int64_t to_s);

 private:
  class Made;
  std::unique_ptr<Made> made_;
  const std::string name_;
};

}  // namespace tribotwin::twin::diagnosis::fleet
