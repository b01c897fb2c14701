#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <unordered_map>

#include <fmt/format.h>
#include <sqlite3.h>

#include <tribotwin/twin/diagnosis/fleet/model_text.hpp>
#include <tribotwin/twin/diagnosis/fleet/store.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/text.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr int application = 0x54424654;  ///< "TBFT" in the file's header
constexpr const char* schema = R"(
CREATE TABLE robots(id INTEGER PRIMARY KEY, type TEXT NOT NULL, name TEXT NOT NULL UNIQUE);
CREATE TABLE joints(id INTEGER PRIMARY KEY, robot INTEGER NOT NULL REFERENCES robots, name TEXT NOT NULL,
  UNIQUE(robot, name));
CREATE TABLE files(id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE);
CREATE TABLE observations(joint INTEGER NOT NULL REFERENCES joints, time_s INTEGER NOT NULL, curve INTEGER NOT NULL,
  learned INTEGER NOT NULL, checksum INTEGER NOT NULL, file INTEGER NOT NULL REFERENCES files, line INTEGER NOT NULL,
  temperature_degC REAL, load_norm REAL, ripple_nm REAL, lost_motion_rad REAL, Fc_nm REAL, Fs_nm REAL, Vs_rad_s REAL,
  Fv REAL, beta REAL, scatter1 REAL, scatter2 REAL, residual_nm REAL, weak TEXT,
  PRIMARY KEY(joint, time_s, curve)) WITHOUT ROWID;
CREATE TABLE models(type TEXT NOT NULL, joint TEXT NOT NULL, model TEXT NOT NULL, PRIMARY KEY(type, joint));
CREATE TABLE checks(kind TEXT NOT NULL, time_s INTEGER NOT NULL, rate REAL NOT NULL, judged INTEGER NOT NULL,
  PRIMARY KEY(kind, time_s));
CREATE TABLE verdicts(kind TEXT NOT NULL, time_s INTEGER NOT NULL, joint INTEGER NOT NULL REFERENCES joints,
  p REAL NOT NULL, q REAL NOT NULL, pattern TEXT NOT NULL, severity REAL, unit TEXT, confidence REAL, margin REAL,
  PRIMARY KEY(kind, time_s, joint)) WITHOUT ROWID;
CREATE TABLE notes(id INTEGER PRIMARY KEY, joint INTEGER REFERENCES joints, time_s INTEGER, text TEXT NOT NULL);
)";

/// "FILE: why": with the system's reason where there is one, as for other files.
std::string why(sqlite3* db) {
  const int system = sqlite3_system_errno(db), code = sqlite3_errcode(db) & 0xff;
  const std::string name = std::filesystem::path(sqlite3_db_filename(db, "main")).filename().string();
  if (code == SQLITE_FULL || ((code == SQLITE_IOERR || code == SQLITE_CANTOPEN) && system != 0))
    return fmt::format("{} or its journal {}-journal: {}", name, name,
                       std::strerror(code == SQLITE_FULL ? ENOSPC : system));
  return fmt::format("{}: {}", name, sqlite3_errmsg(db));
}

/// Whether the name or its permissions are wrong, and not the machine.
bool wrong_name(int code, int system) {
  return code == SQLITE_READONLY || code == SQLITE_PERM ||
         (code == SQLITE_CANTOPEN &&
          (system == EACCES || system == EROFS || system == EPERM || system == ENOENT || system == EISDIR));
}

/// A prepared statement; parameters are bound in the order of their question marks.
class Statement {
 public:
  Statement(sqlite3* db, const char* sql) : db_(db) {
    if (sqlite3_prepare_v3(db, sql, -1, SQLITE_PREPARE_PERSISTENT, &statement_, nullptr) != SQLITE_OK)
      throw std::runtime_error(why(db));
  }
  Statement(const Statement&) = delete;
  ~Statement() { sqlite3_finalize(statement_); }

  template <class... T>
  Statement& operator()(const T&... values) {
    sqlite3_reset(statement_);
    at_ = 0;
    (bind(values), ...);
    return *this;
  }
  /// Whether there is a (further) row.
  bool row() {
    const int code = sqlite3_step(statement_);
    if (code != SQLITE_ROW) sqlite3_reset(statement_);
    if (code != SQLITE_ROW && code != SQLITE_DONE) throw std::runtime_error(why(db_));
    return code == SQLITE_ROW;
  }
  /// Runs a statement without a result.
  void run() {
    while (row()) {
    }
  }
  std::int64_t integer(int column) const { return sqlite3_column_int64(statement_, column); }
  double real(int column) const {
    return sqlite3_column_type(statement_, column) == SQLITE_NULL ? std::numeric_limits<double>::quiet_NaN()
                                                                  : sqlite3_column_double(statement_, column);
  }
  std::string text(int column) const {
    const auto* bytes = sqlite3_column_text(statement_, column);
    return bytes ? std::string(reinterpret_cast<const char*>(bytes)) : std::string();
  }

 private:
  void bind(std::int64_t x) { sqlite3_bind_int64(statement_, ++at_, x); }
  void bind(double x) {
    std::isfinite(x) ? sqlite3_bind_double(statement_, ++at_, x) : sqlite3_bind_null(statement_, ++at_);
  }
  void bind(const std::optional<double>& x) { bind(x.value_or(std::numeric_limits<double>::quiet_NaN())); }
  void bind(const std::string& x) {
    sqlite3_bind_text(statement_, ++at_, x.data(), static_cast<int>(x.size()), SQLITE_TRANSIENT);
  }

  sqlite3* db_;
  sqlite3_stmt* statement_ = nullptr;
  int at_ = 0;
};

std::int64_t whole(std::size_t x) { return static_cast<std::int64_t>(x); }

struct Close {
  void operator()(sqlite3* db) const { sqlite3_close(db); }
};

std::unique_ptr<sqlite3, Close> opened(const std::filesystem::path& file) {
  sqlite3* raw = nullptr;
  const int code = sqlite3_open_v2(file.c_str(), &raw, SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, nullptr);
  std::unique_ptr<sqlite3, Close> db(raw);
  if (code != SQLITE_OK) {
    const int system = raw ? sqlite3_system_errno(raw) : ENOMEM;
    const std::string message =
        fmt::format("{}: {}", file.string(), system ? std::strerror(system) : sqlite3_errstr(code));
    const auto folder = std::filesystem::absolute(file).parent_path();
    // As below: in a folder that exists a new file is not missing.
    if (wrong_name(code, system) && !(system == ENOENT && std::filesystem::is_directory(folder)))
      throw InputError(message);
    throw std::runtime_error(message);
  }
  sqlite3_busy_timeout(raw, 10000);
  return db;
}

}  // namespace

class Store::Made {
 public:
  explicit Made(const std::filesystem::path& file) : file_(file), was_there_(std::filesystem::exists(file)) {
    if (was_there_ && !std::filesystem::is_regular_file(file))
      throw InputError(fmt::format("{}: is no regular file; -o names the fleet's store", file.string()));
    db_ = opened(file);
    try {
      begin();
    } catch (...) {
      leave();
      throw;
    }
  }
  ~Made() {
    statements_.clear();
    if (!committed_) leave();
  }

  Statement& statement(const char* sql) {
    auto& place = statements_[sql];
    if (!place) place = std::make_unique<Statement>(db_.get(), sql);
    return *place;
  }

  std::int64_t joint(const Key& key) {
    auto& robot = robots_[key.robot];
    if (robot == 0) robot = robot_id(key);
    auto& joint = joints_[{robot, key.joint}];
    if (joint == 0)
      joint = id("SELECT id FROM joints WHERE robot = ? AND name = ?", "INSERT INTO joints(robot, name) VALUES(?, ?)",
                 robot, key.joint);
    return joint;
  }
  /// 0 where there is none.
  std::int64_t known_joint(const Key& key) {
    auto& s = statement(
        "SELECT joints.id FROM joints JOIN robots ON robots.id = joints.robot WHERE robots.name = ? AND "
        "joints.name = ?")(key.robot, key.joint);
    const std::int64_t id = s.row() ? s.integer(0) : 0;
    if (id) s.run();
    return id;
  }
  std::int64_t file_id(const std::string& name) {
    auto& place = files_[name];
    if (place == 0) place = id("SELECT id FROM files WHERE name = ?", "INSERT INTO files(name) VALUES(?)", name);
    return place;
  }
  void execute(const char* sql) {
    if (sqlite3_exec(db_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) throw std::runtime_error(why(db_.get()));
  }
  void commit() {
    execute("COMMIT");
    committed_ = true;
  }

 private:
  void begin() {
    const int code = sqlite3_exec(db_.get(), "PRAGMA cache_size = -65536; BEGIN IMMEDIATE", nullptr, nullptr, nullptr);
    const auto no_store = [&] {
      return InputError(fmt::format("{}: is no store of tribotwin fleet; name one, or a new file", file_.string()));
    };
    if (code == SQLITE_NOTADB) throw no_store();
    // Without its journal a file that could be opened fails by the machine: SQLite keeps no better reason than ENOENT.
    const int system = sqlite3_system_errno(db_.get());
    if (system != ENOENT && wrong_name(code, system)) throw InputError(why(db_.get()));
    if (code != SQLITE_OK) throw std::runtime_error(why(db_.get()));
    auto& of = statement("PRAGMA application_id")();
    const bool ours = of.row() && of.integer(0) == application;
    of.run();
    if (ours) return;
    auto& tables = statement("SELECT count(*) FROM sqlite_master")();
    const bool empty = tables.row() && tables.integer(0) == 0;
    tables.run();
    if (!empty) throw no_store();
    execute(schema);
    execute(fmt::format("PRAGMA application_id = {}", application).c_str());
  }
  void leave() {
    statements_.clear();
    sqlite3_exec(db_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    db_.reset();
    std::error_code ignored;
    if (was_there_) return;
    std::filesystem::remove(file_, ignored);
    std::filesystem::remove(file_.string() + "-journal", ignored);
  }

  std::int64_t robot_id(const Key& key) {
    auto& s = statement("SELECT id, type FROM robots WHERE name = ?")(key.robot);
    if (!s.row()) {
      statement("INSERT INTO robots(name, type) VALUES(?, ?)")(key.robot, key.type).run();
      return sqlite3_last_insert_rowid(db_.get());
    }
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
    statement(insert)(values...).run();
    return sqlite3_last_insert_rowid(db_.get());
  }

  const std::filesystem::path file_;
  const bool was_there_;
  bool committed_ = false;
  std::unique_ptr<sqlite3, Close> db_;
  std::unordered_map<const char*, std::unique_ptr<Statement>> statements_;
  std::unordered_map<std::string, std::int64_t> robots_, files_;
  std::map<std::pair<std::int64_t, std::string>, std::int64_t> joints_;
};

Store::Store(const std::filesystem::path& file) : made_(std::make_unique<Made>(file)) {}
Store::~Store() = default;

void Store::commit() { made_->commit(); }

Store::Put Store::look(const Entry& e, bool learned) {
  const std::int64_t joint = made_->known_joint(e.key);
  if (joint == 0) return Put::added;
  auto& s = made_->statement("SELECT checksum, learned FROM observations WHERE joint = ? AND time_s = ? AND curve = ?")(
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
        ->statement("UPDATE observations SET learned = 1 WHERE joint = ? AND time_s = ? AND curve = ?")(
            joint, e.key.time_s, curve)
        .run();
    return what;
  }
  const Observation& o = e.observation;
  const std::string weak = joined(o.weak);
  made_
      ->statement(
          "INSERT OR REPLACE INTO observations VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")(
          joint, e.key.time_s, curve, std::int64_t{learned}, std::int64_t{e.checksum}, made_->file_id(e.file),
          whole(e.line), o.temperature_degC, o.indicators[load], o.indicators[ripple], o.indicators[lost_motion],
          o.features(0), o.features(1), o.features(2), o.features(3), o.features(4), shape_scatter(o.shape, regions[0]),
          shape_scatter(o.shape, regions[1]), o.residual_nm, weak)
      .run();
  if (!weak.empty())
    made_
        ->statement("INSERT INTO notes(joint, time_s, text) VALUES(?, ?, ?)")(
            joint, e.key.time_s, fmt::format("{}:{}: not identifiable from its levels: {}", e.file, e.line, weak))
        .run();
  return what == Put::changed ? Put::replaced : what;
}

std::string Store::origin(const Key& key) {
  auto& s = made_->statement(
      "SELECT files.name, line FROM observations JOIN files ON files.id = file WHERE joint = ? AND "
      "time_s = ? AND curve = ?")(made_->known_joint(key), key.time_s, std::int64_t{key.curve});
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
      "SELECT time_s, temperature_degC, load_norm, Fc_nm, Fs_nm, Vs_rad_s, Fv, beta, scatter1, scatter2 FROM "
      "observations WHERE joint = ? AND time_s BETWEEN ? AND ? AND learned = ? AND weak = '' ORDER BY time_s, curve")(
      joint, from_s, to_s, std::int64_t{learned});
  while (s.row()) {
    Observation o;
    for (int i = 0; i < feature_count; ++i) o.features(i) = s.real(3 + i);
    out.push_back({.day = static_cast<double>(s.integer(0)) / 86400,
                   .temperature_degC = s.real(1),
                   .load_norm = s.real(2),
                   .logarithmic = o.logarithmic(),
                   .scatter = {s.real(8), s.real(9)}});
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
  made_->statement("INSERT OR REPLACE INTO models VALUES(?, ?, ?)")(model.type, model.joint, to_text(model)).run();
}

std::vector<std::string> Store::model_texts() {
  std::vector<std::string> all;
  auto& s = made_->statement("SELECT model FROM models ORDER BY type, joint")();
  while (s.row()) all.push_back(s.text(0));
  return all;
}

void Store::put_verdicts(const std::string& kind, std::int64_t time_s, double rate, std::size_t judged,
                         const std::vector<StoredVerdict>& verdicts) {
  made_->statement("DELETE FROM verdicts WHERE kind = ? AND time_s = ?")(kind, time_s).run();
  made_->statement("INSERT OR REPLACE INTO checks VALUES(?, ?, ?, ?)")(kind, time_s, rate, whole(judged)).run();
  for (const auto& v : verdicts)
    made_
        ->statement("INSERT INTO verdicts VALUES(?, ?, ?, ?, ?, ?, ?, ?, ?, ?)")(
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
      "SELECT files.name, count(*), sum(weak != ''), count(DISTINCT joints.robot) FROM observations JOIN files ON "
      "files.id = file JOIN joints ON joints.id = joint WHERE learned = 0 AND time_s BETWEEN ? AND ? GROUP BY file "
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
      "ON robots.id = joints.robot WHERE time_s BETWEEN ? AND ? OR time_s IS NULL ORDER BY time_s, notes.id")(from_s,
                                                                                                              to_s);
  while (s.row()) all.push_back({.robot = s.text(0), .joint = s.text(1), .text = s.text(2), .time_s = s.integer(3)});
  return all;
}

}  // namespace tribotwin::twin::diagnosis::fleet
