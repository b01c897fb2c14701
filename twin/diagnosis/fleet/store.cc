#include <algorithm>
#include <array>
#include <cmath>
#include <initializer_list>
#include <map>
#include <optional>
#include <stdexcept>
#include <unordered_map>

#include <fmt/format.h>

#include <tribotwin/twin/diagnosis/fleet/claims.hpp>
#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/diagnosis/fleet/store.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr const char* schema = R"(
CREATE TABLE robots(id INTEGER PRIMARY KEY, type TEXT NOT NULL, name TEXT NOT NULL UNIQUE);
CREATE TABLE joints(id INTEGER PRIMARY KEY, robot INTEGER NOT NULL REFERENCES robots, name TEXT NOT NULL,
  UNIQUE(robot, name));
CREATE TABLE files(id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE observations(joint INTEGER NOT NULL REFERENCES joints, time_s INTEGER NOT NULL, curve INTEGER NOT NULL,
  learned INTEGER NOT NULL, checksum INTEGER NOT NULL, file INTEGER NOT NULL REFERENCES files, line INTEGER NOT NULL,
  temperature_degC REAL, load_norm REAL, ripple_nm REAL, lost_motion_rad REAL, Fc_nm REAL, Fs_nm REAL, Vs_rad_s REAL,
  Fv REAL, beta REAL, scatter1 REAL, scatter2 REAL, residual_nm REAL, weak TEXT,
  claim11 REAL, claim21 REAL, claim22 REAL, claim31 REAL, claim32 REAL, claim33 REAL, claim44 REAL, claim54 REAL,
  claim55 REAL,
  PRIMARY KEY(joint, time_s, curve)) WITHOUT ROWID;
CREATE TABLE models(type TEXT NOT NULL, joint TEXT NOT NULL, model TEXT NOT NULL, PRIMARY KEY(type, joint));
CREATE TABLE checks(kind TEXT NOT NULL, time_s INTEGER NOT NULL, rate REAL NOT NULL, judged INTEGER NOT NULL,
  PRIMARY KEY(kind, time_s));
CREATE TABLE verdicts(kind TEXT NOT NULL, time_s INTEGER NOT NULL, joint INTEGER NOT NULL REFERENCES joints,
  p REAL NOT NULL, q REAL NOT NULL, pattern TEXT NOT NULL, severity REAL, unit TEXT, confidence REAL, margin REAL,
  PRIMARY KEY(kind, time_s, joint)) WITHOUT ROWID;
CREATE TABLE notes(id INTEGER PRIMARY KEY, joint INTEGER REFERENCES joints, time_s INTEGER, text TEXT NOT NULL);
)";

/// Of ClaimRoots; stores of earlier versions have none.
constexpr std::array claim_columns{"claim11", "claim21", "claim22", "claim31", "claim32",
                                   "claim33", "claim44", "claim54", "claim55"};

/// Column of an observation and what it may be: a store is a plain file, in which others may have written.
struct KeptNumber {
  std::string_view name;
  Bounds range;
  bool may_lack = false;

  bool contains(double x) const { return std::isnan(x) ? may_lack : x >= range.minimum && x <= range.maximum; }
};
constexpr Bounds positive{0, 1e12}, of_any_sign{-1e12, 1e12}, claimed{0, 1e9}, coupled{-1e9, 1e9};
constexpr std::array kept_numbers{KeptNumber{"time_s", {-62167219200, 253402300799}},  // years 0 to 9999
                                  KeptNumber{"temperature_degC", {-273.15, 1000}, true},
                                  KeptNumber{"load_norm", of_any_sign, true},
                                  KeptNumber{"Fc_nm", positive},
                                  KeptNumber{"Fs_nm", positive},
                                  KeptNumber{"Vs_rad_s", positive},
                                  KeptNumber{"Fv", positive},
                                  KeptNumber{"beta", of_any_sign},
                                  KeptNumber{"scatter1", positive},
                                  KeptNumber{"scatter2", positive},
                                  KeptNumber{"claim11", claimed, true},
                                  KeptNumber{"claim21", coupled, true},
                                  KeptNumber{"claim22", claimed, true},
                                  KeptNumber{"claim31", coupled, true},
                                  KeptNumber{"claim32", coupled, true},
                                  KeptNumber{"claim33", claimed, true},
                                  KeptNumber{"claim44", claimed, true},
                                  KeptNumber{"claim54", coupled, true},
                                  KeptNumber{"claim55", claimed, true}};
/// Of all roots that a region claims; smaller ones are 0, as those of a region that claims nothing.
constexpr float least_claim = 1e-9F;

/// The name of the first number that a row may not have; empty where there is none.
std::string_view wrong_number(const Statement& s) {
  for (std::size_t i = 0; i < kept_numbers.size(); ++i)
    if (!kept_numbers[i].contains(s.real(static_cast<int>(i)))) return kept_numbers[i].name;
  return {};
}

/// Whether the roots of each region are of a covariance, or none.
bool whole_claims(const ClaimRoots& c) {
  const auto is_root = [&](std::size_t first, std::initializer_list<std::size_t> others) {
    return c[first] == 0 ||
           (c[first] >= least_claim && std::ranges::all_of(others, [&](std::size_t i) { return c[i] >= least_claim; }));
  };
  return is_root(0, {2, 5}) && is_root(6, {8});
}

std::int64_t whole(std::size_t x) { return static_cast<std::int64_t>(x); }

/// Beginnings of notes: "check failed: ", "fit of curve 3 failed: ".
constexpr char failed[] = " failed: ", fit_of_curve[] = "fit of curve ";
std::string failure_of_fit(std::int64_t curve) { return fmt::format("{}{}{}", fit_of_curve, curve, failed); }
std::string failure_of_model(const std::string& type, const std::string& joint) {
  return fmt::format("model of {}{}", name_of(type, joint), failed);
}

}  // namespace

class Store::Made {
 public:
  explicit Made(const std::string& name) : database_(open_database(name, schema)) {
    for (const char* column : claim_columns) database_->add_column("observations", column);
  }

  Statement& statement(const char* sql) { return database_->statement(sql); }
  void commit() { database_->commit(); }

  std::int64_t joint(const Key& key) {
    auto& robot = robots_[key.robot];
    if (robot == 0) robot = robot_id(key);
    auto& joint = joints_[{robot, key.joint}];
    if (joint == 0)
      joint = id("SELECT id FROM joints WHERE robot = $1 AND name = $2",
                 "INSERT INTO joints(id, robot, name) VALUES((SELECT coalesce(max(id), 0) + 1 FROM joints), $1, $2) "
                 "RETURNING id",
                 robot, key.joint);
    return joint;
  }
  /// 0 where there is none.
  std::int64_t known_joint(const Key& key) {
    auto& s = statement(
        "SELECT joints.id FROM joints JOIN robots ON robots.id = joints.robot WHERE robots.name = $1 AND "
        "joints.name = $2")(key.robot, key.joint);
    const std::int64_t id = s.row() ? s.integer(0) : 0;
    if (id) s.run();
    return id;
  }
  /// Of an observation with numbers that are none of ours.
  [[noreturn]] void refuse(const std::string& store, std::int64_t joint, std::int64_t time_s, std::string_view what) {
    auto& s = statement(
        "SELECT robots.name, joints.name FROM joints JOIN robots ON robots.id = joints.robot WHERE joints.id = $1")(
        joint);
    const bool known = s.row();
    throw InputError(fmt::format(
        "{}: robot {}, joint {}, {}: {} is no number that tribotwin fleet writes there; the "
        "store was changed",
        store, known ? printable(s.text(0)) : "?", known ? printable(s.text(1)) : "?", date_of(time_s), what));
  }
  void note(std::int64_t joint, std::int64_t time_s, const std::string& text) {
    statement(
        "INSERT INTO notes(id, joint, time_s, text) VALUES((SELECT coalesce(max(id), 0) + 1 FROM notes), $1, $2, $3)")(
        joint, time_s, text)
        .run();
  }
  void forget_failure(std::int64_t joint, std::int64_t time_s, const std::string& prefix) {
    statement("DELETE FROM notes WHERE joint = $1 AND time_s = $2 AND text LIKE $3")(joint, time_s, prefix + "%").run();
  }
  void forget_failed_model(const std::string& prefix) {
    statement("DELETE FROM notes WHERE joint IS NULL AND substr(text, 1, length($1)) = $1")(prefix).run();
  }
  /// Whether the store was opened with notes of fits that failed.
  bool fits_failed() {
    if (!fits_failed_) {
      auto& s = statement("SELECT count(*) FROM notes WHERE text LIKE $1")(std::string(fit_of_curve) + "%");
      fits_failed_ = s.row() && s.integer(0) > 0;
      s.run();
    }
    return *fits_failed_;
  }
  std::int64_t file_id(const std::string& name) {
    auto& place = files_[name];
    if (place == 0)
      place =
          id("SELECT id FROM files WHERE name = $1",
             "INSERT INTO files(id, name) VALUES((SELECT coalesce(max(id), 0) + 1 FROM files), $1) RETURNING id", name);
    return place;
  }

 private:
  std::int64_t robot_id(const Key& key) {
    auto& s = statement("SELECT id, type FROM robots WHERE name = $1")(key.robot);
    if (!s.row())
      return added(
          "INSERT INTO robots(id, name, type) VALUES((SELECT coalesce(max(id), 0) + 1 FROM robots), $1, $2) RETURNING "
          "id",
          key.robot, key.type);
    const std::int64_t id = s.integer(0);
    const std::string type = s.text(1);
    s.run();
    if (type != key.type)
      throw InputError(fmt::format("robot {}: is of type '{}' here and of '{}' in the store; a robot has one type",
                                   printable(key.robot), printable(key.type), printable(type)));
    return id;
  }
  template <class... T>
  std::int64_t id(const char* find, const char* insert, const T&... values) {
    auto& s = statement(find)(values...);
    if (s.row()) {
      const std::int64_t found = s.integer(0);
      s.run();
      return found;
    }
    return added(insert, values...);
  }
  /// Of a statement that returns the id; one above the largest, as SQLite would choose it.
  template <class... T>
  std::int64_t added(const char* insert, const T&... values) {
    auto& s = statement(insert)(values...);
    if (!s.row()) throw std::logic_error(insert);
    const std::int64_t id = s.integer(0);
    s.run();
    return id;
  }

  const std::unique_ptr<Database> database_;
  std::unordered_map<std::string, std::int64_t> robots_, files_;
  std::optional<bool> fits_failed_;
  std::map<std::pair<std::int64_t, std::string>, std::int64_t> joints_;
};

Store::Store(const std::string& name) : made_(std::make_unique<Made>(name)), name_(without_password(name)) {}
Store::~Store() = default;

void Store::commit() { made_->commit(); }

Store::Put Store::look(const Entry& e, bool learned) {
  const std::int64_t joint = made_->known_joint(e.key);
  if (joint == 0) return Put::added;
  auto& s =
      made_->statement("SELECT checksum, learned FROM observations WHERE joint = $1 AND time_s = $2 AND curve = $3")(
          joint, e.key.time_s, std::int64_t{e.key.curve});
  if (!s.row()) return Put::added;
  const bool same = s.integer(0) == std::int64_t{e.checksum}, was_learned = s.integer(1) != 0;
  s.run();
  if (!same) return Put::changed;
  return learned && !was_learned ? Put::promoted : Put::known;
}

Store::Put Store::put(const Entry& e, bool learned, bool replace) {
  Put what = look(e, learned);
  const std::int64_t joint = made_->joint(e.key), curve = e.key.curve;
  if (what == Put::known || (what == Put::changed && !replace)) return what;
  if (what == Put::promoted) {
    made_
        ->statement("UPDATE observations SET learned = 1 WHERE joint = $1 AND time_s = $2 AND curve = $3")(
            joint, e.key.time_s, curve)
        .run();
    return what;
  }
  if (what == Put::changed)
    made_
        ->statement("DELETE FROM observations WHERE joint = $1 AND time_s = $2 AND curve = $3")(joint, e.key.time_s,
                                                                                                curve)
        .run();
  if (made_->fits_failed()) made_->forget_failure(joint, e.key.time_s, failure_of_fit(curve));
  const Observation& o = e.observation;
  const std::string weak = joined(o.weak);
  const auto claim = claim_roots(o.shape);
  const auto root = [&](std::size_t i) { return double{claim[i]}; };
  made_
      ->statement(
          "INSERT INTO observations VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10, $11, $12, $13, $14, $15, $16, $17, "
          "$18, $19, $20, $21, $22, $23, $24, $25, $26, $27, $28, $29)")(
          joint, e.key.time_s, curve, std::int64_t{learned}, std::int64_t{e.checksum}, made_->file_id(e.file),
          whole(e.line), o.temperature_degC, o.indicators[load], o.indicators[ripple], o.indicators[lost_motion],
          o.features(0), o.features(1), o.features(2), o.features(3), o.features(4), shape_scatter(o.shape, regions[0]),
          shape_scatter(o.shape, regions[1]), o.residual_nm, weak, root(0), root(1), root(2), root(3), root(4), root(5),
          root(6), root(7), root(8))
      .run();
  if (!weak.empty())
    made_->note(joint, e.key.time_s, fmt::format("{}:{}: not identifiable from its levels: {}", e.file, e.line, weak));
  return what == Put::changed ? Put::replaced : what;
}

void Store::put_failure(const std::string& work, const Key& key, const std::string& text) {
  const std::int64_t joint = made_->joint(key);
  const std::string prefix = work == "fit" ? failure_of_fit(key.curve) : work + failed;
  made_->forget_failure(joint, key.time_s, prefix);
  made_->note(joint, key.time_s, prefix + text);
}

std::string Store::origin(const Key& key) {
  auto& s = made_->statement(
      "SELECT files.name, line FROM observations JOIN files ON files.id = file WHERE joint = $1 AND "
      "time_s = $2 AND curve = $3")(made_->known_joint(key), key.time_s, std::int64_t{key.curve});
  if (!s.row()) return {};
  std::string where = fmt::format("{}:{}", s.text(0), s.integer(1));
  s.run();
  return where;
}

std::vector<JointName> Store::joints() {
  std::vector<JointName> all;
  auto& s = made_->statement(
      "SELECT joints.id, type, robots.name, joints.name FROM joints JOIN robots ON robots.id = "
      "joints.robot ORDER BY type, joints.name, robots.name")();
  while (s.row()) all.push_back({s.integer(0), s.text(1), s.text(2), s.text(3)});
  return all;
}

Rows Store::rows(std::int64_t joint, bool learned, std::int64_t from_s, std::int64_t to_s) {
  Rows out;
  auto& s = made_->statement(
      "SELECT time_s, temperature_degC, load_norm, Fc_nm, Fs_nm, Vs_rad_s, Fv, beta, scatter1, scatter2, claim11, "
      "claim21, claim22, claim31, claim32, claim33, claim44, claim54, claim55 FROM observations WHERE joint = $1 AND "
      "time_s BETWEEN $2 AND $3 AND learned = $4 AND weak = '' ORDER BY time_s, "
      "curve")(joint, from_s, to_s, std::int64_t{learned});
  while (s.row()) {
    if (const auto wrong = wrong_number(s); !wrong.empty()) made_->refuse(name_, joint, s.integer(0), wrong);
    Observation o;
    for (int i = 0; i < feature_count; ++i) o.features(i) = s.real(3 + i);
    out.push_back({.day = static_cast<double>(s.integer(0)) / 86400,
                   .temperature_degC = s.real(1),
                   .load_norm = s.real(2),
                   .logarithmic = o.logarithmic(),
                   .scatter = {s.real(8), s.real(9)}});
    for (int i = 0; i < 9; ++i) {
      const double x = s.real(10 + i);
      out.back().claim[static_cast<std::size_t>(i)] = std::isfinite(x) ? static_cast<float>(x) : 0;
    }
    if (!whole_claims(out.back().claim)) made_->refuse(name_, joint, s.integer(0), "claim11 to claim55");
  }
  return out;
}

std::optional<std::int64_t> Store::newest() {
  auto& s = made_->statement(
      "SELECT time_s FROM observations WHERE learned = 0 AND weak = '' ORDER BY time_s DESC LIMIT 1")();
  if (!s.row()) return std::nullopt;
  const std::int64_t time_s = s.integer(0);
  s.run();
  return time_s;
}

void Store::put_model(const TypeModel& model) {
  made_
      ->statement(
          "INSERT INTO models VALUES($1, $2, $3) ON CONFLICT(type, joint) DO UPDATE SET model = excluded.model")(
          model.type, model.joint, to_text(model))
      .run();
  made_->forget_failed_model(failure_of_model(model.type, model.joint));
}

void Store::put_failed_model(const std::string& type, const std::string& joint, const std::string& text) {
  const std::string prefix = failure_of_model(type, joint);
  made_->forget_failed_model(prefix);
  made_
      ->statement("INSERT INTO notes(id, text) VALUES((SELECT coalesce(max(id), 0) + 1 FROM notes), $1)")(prefix + text)
      .run();
}

std::vector<std::string> Store::model_texts() {
  std::vector<std::string> all;
  auto& s = made_->statement("SELECT model FROM models ORDER BY type, joint")();
  while (s.row()) all.push_back(s.text(0));
  return all;
}

void Store::put_verdicts(const std::string& kind, std::int64_t time_s, double rate, std::size_t judged,
                         const std::vector<StoredVerdict>& verdicts) {
  made_->statement("DELETE FROM verdicts WHERE kind = $1 AND time_s = $2")(kind, time_s).run();
  made_->statement("DELETE FROM notes WHERE time_s = $1 AND text LIKE $2")(time_s, kind + failed + "%").run();
  made_
      ->statement(
          "INSERT INTO checks VALUES($1, $2, $3, $4) ON CONFLICT(kind, time_s) DO UPDATE SET rate = excluded.rate, "
          "judged = excluded.judged")(kind, time_s, rate, whole(judged))
      .run();
  for (const auto& v : verdicts)
    made_
        ->statement("INSERT INTO verdicts VALUES($1, $2, $3, $4, $5, $6, $7, $8, $9, $10)")(
            kind, time_s, v.joint, v.p, v.q, v.pattern, v.severity, v.unit, v.confidence, v.margin)
        .run();
}

std::vector<PastCheck> Store::checks() {
  std::vector<PastCheck> all;
  auto& s = made_->statement(
      "SELECT c.kind, c.time_s, c.rate, c.judged, (SELECT count(*) FROM verdicts v WHERE v.kind = c.kind AND "
      "v.time_s = c.time_s) FROM checks c ORDER BY c.time_s, c.kind")();
  while (s.row())
    all.push_back({.kind = s.text(0),
                   .time_s = s.integer(1),
                   .rate = s.real(2),
                   .judged = static_cast<std::size_t>(s.integer(3)),
                   .listed = static_cast<std::size_t>(s.integer(4))});
  return all;
}

std::vector<ImportedFile> Store::files(std::int64_t from_s, std::int64_t to_s) {
  std::vector<ImportedFile> all;
  auto& s = made_->statement(
      "SELECT files.name, count(*), sum(CASE WHEN weak <> '' THEN 1 ELSE 0 END), count(DISTINCT joints.robot) FROM "
      "observations JOIN files ON "
      "files.id = file JOIN joints ON joints.id = joint WHERE learned = 0 AND time_s BETWEEN $1 AND $2 GROUP BY "
      "files.id "
      "ORDER BY files.name")(from_s, to_s);
  while (s.row())
    all.push_back({.name = s.text(0),
                   .curves = static_cast<std::size_t>(s.integer(1)),
                   .weak = static_cast<std::size_t>(s.integer(2)),
                   .robots = static_cast<std::size_t>(s.integer(3))});
  return all;
}

std::vector<StoredNote> Store::notes(std::int64_t from_s, std::int64_t to_s) {
  std::vector<StoredNote> all;
  auto& s = made_->statement(
      "SELECT robots.name, joints.name, text, time_s FROM notes LEFT JOIN joints ON joints.id = joint LEFT JOIN robots "
      "ON robots.id = joints.robot WHERE time_s BETWEEN $1 AND $2 OR time_s IS NULL ORDER BY time_s NULLS FIRST, "
      "notes.id")(from_s, to_s);
  while (s.row()) all.push_back({.robot = s.text(0), .joint = s.text(1), .text = s.text(2), .time_s = s.integer(3)});
  return all;
}

}  // namespace tribotwin::twin::diagnosis::fleet
