#include <cerrno>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <limits>
#include <stdexcept>

#include <fmt/format.h>
#include <sqlite3.h>

#include <tribotwin/plugins/friction/limits.hpp>
#include <tribotwin/twin/diagnosis/fleet/database/database.hpp>
#include <tribotwin/twin/io/input.hpp>
#include <tribotwin/twin/io/interrupt.hpp>

namespace tribotwin::twin::diagnosis::fleet {
namespace {

constexpr int application = 0x54424654;  ///< "TBFT" in the file's header

std::string file_name(sqlite3* db) {
  return std::filesystem::path(sqlite3_db_filename(db, "main")).filename().string();
}

/// "FILE: why": with the system's reason where there is one, as for other files. SQLite quotes the file's schema.
std::string why(sqlite3* db) {
  const int system = sqlite3_system_errno(db), code = sqlite3_errcode(db) & 0xff;
  const std::string name = file_name(db);
  if (code == SQLITE_FULL || ((code == SQLITE_IOERR || code == SQLITE_CANTOPEN) && system != 0))
    return fmt::format("{} or its journal {}-journal: {}", name, name,
                       std::strerror(code == SQLITE_FULL ? ENOSPC : system));
  return fmt::format("{}: {}", name, without_controls(sqlite3_errmsg(db)));
}

/// Throws what the last call failed by: InputError where it is what the file holds, not the machine.
[[noreturn]] void fail(sqlite3* db) {
  switch (sqlite3_errcode(db) & 0xff) {
    case SQLITE_CORRUPT:
      break;
    case SQLITE_READONLY:  // a file without permission is refused when it is opened: a header of a later SQLite
      if (sqlite3_extended_errcode(db) == SQLITE_READONLY) break;
      throw std::runtime_error(why(db));
    case SQLITE_ERROR:
    case SQLITE_CONSTRAINT:
    case SQLITE_MISMATCH:
    case SQLITE_TOOBIG:
      throw InputError(fmt::format("{}; its tables are not those of a store of tribotwin fleet", why(db)));
    default:
      throw std::runtime_error(why(db));
  }
  throw InputError(fmt::format(
      "{}: is damaged, or was changed by another program; restore a copy of it, or learn again into a new file",
      file_name(db)));
}

/// Whether the name or its permissions are wrong, and not the machine.
bool wrong_name(int code, int system) {
  return code == SQLITE_READONLY || code == SQLITE_PERM ||
         (code == SQLITE_CANTOPEN && (system == EACCES || system == EPERM || system == ENOENT || system == EISDIR));
}

class SqliteStatement : public Statement {
 public:
  SqliteStatement(sqlite3* db, const char* sql) : db_(db) {
    const int code = sqlite3_prepare_v3(db, sql, -1, SQLITE_PREPARE_PERSISTENT, &statement_, nullptr);
    if (code != SQLITE_OK) fail(db);
    // To SQLite $1 is a name; its number is that of its first use.
    for (int i = 1; i <= sqlite3_bind_parameter_count(statement_); ++i)
      if (const char* name = sqlite3_bind_parameter_name(statement_, i); !name || name != fmt::format("${}", i)) {
        sqlite3_finalize(statement_);
        throw std::logic_error(fmt::format("parameters out of order: {}", sql));
      }
  }
  ~SqliteStatement() override { sqlite3_finalize(statement_); }

  bool row() override {
    const int code = sqlite3_step(statement_);
    if (code != SQLITE_ROW) sqlite3_reset(statement_);
    if (code != SQLITE_ROW && code != SQLITE_DONE) fail(db_);
    return code == SQLITE_ROW;
  }
  std::int64_t integer(int column) const override { return sqlite3_column_int64(statement_, column); }
  double real(int column) const override {
    const int type = sqlite3_column_type(statement_, column);
    return type == SQLITE_FLOAT || type == SQLITE_INTEGER ? sqlite3_column_double(statement_, column)
                                                          : std::numeric_limits<double>::quiet_NaN();
  }
  std::string text(int column) const override {
    const auto* bytes = sqlite3_column_text(statement_, column);
    return bytes ? std::string(reinterpret_cast<const char*>(bytes)) : std::string();
  }

 private:
  void reset() override { sqlite3_reset(statement_); }
  void bind(int at, std::int64_t x) override { sqlite3_bind_int64(statement_, at, x); }
  void bind(int at, double x) override {
    std::isfinite(x) ? sqlite3_bind_double(statement_, at, x) : sqlite3_bind_null(statement_, at);
  }
  void bind(int at, const std::string& x) override {
    sqlite3_bind_text(statement_, at, x.data(), static_cast<int>(x.size()), SQLITE_TRANSIENT);
  }

  sqlite3* db_;
  sqlite3_stmt* statement_ = nullptr;
};

struct Close {
  void operator()(sqlite3* db) const { sqlite3_close(db); }
};

/// A store has tables alone: what a file has of triggers and views, and functions of its schema, is somebody else's.
void run_nothing_of(sqlite3* db) {
  for (const int what : {SQLITE_DBCONFIG_ENABLE_TRIGGER, SQLITE_DBCONFIG_ENABLE_VIEW, SQLITE_DBCONFIG_TRUSTED_SCHEMA})
    sqlite3_db_config(db, what, 0, nullptr);
  sqlite3_limit(db, SQLITE_LIMIT_LENGTH, static_cast<int>(limits::text_bytes));
}

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
  run_nothing_of(raw);
  return db;
}

class Sqlite : public Database {
 public:
  Sqlite(const std::filesystem::path& file, const char* schema)
      : file_(file), was_there_(std::filesystem::exists(file)) {
    if (was_there_ && !std::filesystem::is_regular_file(file))
      throw InputError(fmt::format("{}: is no regular file; -o names the fleet's store", file.string()));
    db_ = opened(file);
    try {
      begin(schema);
    } catch (...) {
      leave();
      throw;
    }
  }
  ~Sqlite() override {
    forget_statements();
    if (!committed_) leave();
  }
  void commit() override {
    new_ = {}, new_journal_ = {};
    execute("COMMIT");
    committed_ = true;
  }
  void add_column(const std::string& table, const std::string& column) override {
    auto& known = statement("SELECT count(*) FROM pragma_table_info($1) WHERE name = $2")(table, column);
    const bool has = known.row() && known.integer(0) > 0;
    known.run();
    if (!has) execute(fmt::format("ALTER TABLE {} ADD COLUMN {} REAL", table, column).c_str());
  }

 private:
  std::unique_ptr<Statement> prepare(const char* sql) override {
    return std::make_unique<SqliteStatement>(db_.get(), sql);
  }
  void execute(const char* sql) {
    if (sqlite3_exec(db_.get(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) fail(db_.get());
  }
  void begin(const char* schema) {
    const int code = sqlite3_exec(db_.get(), "PRAGMA cache_size = -65536; BEGIN IMMEDIATE", nullptr, nullptr, nullptr);
    const auto no_store = [&] {
      return InputError(fmt::format("{}: is no store of tribotwin fleet; name one, or a new file", file_.string()));
    };
    if (code == SQLITE_NOTADB) throw no_store();
    // Without its journal a file that could be opened fails by the machine: SQLite keeps no better reason than ENOENT.
    const int system = sqlite3_system_errno(db_.get());
    if (system != ENOENT && wrong_name(code, system)) throw InputError(why(db_.get()));
    if (code != SQLITE_OK) fail(db_.get());
    auto& of = statement("PRAGMA application_id")();
    const bool ours = of.row() && of.integer(0) == application;
    of.run();
    if (ours) return;
    auto& tables = statement("SELECT count(*) FROM sqlite_master")();
    const bool empty = tables.row() && tables.integer(0) == 0;
    tables.run();
    if (!empty) throw no_store();
    // Only now: whoever made the file before it was locked may have rows in it.
    if (!was_there_) mine_ = true, new_ = Temporary(file_), new_journal_ = Temporary(file_.string() + "-journal");
    execute(schema);
    execute(fmt::format("PRAGMA application_id = {}", application).c_str());
  }
  void leave() {
    forget_statements();
    sqlite3_exec(db_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
    db_.reset();
    std::error_code ignored;
    if (!mine_) return;
    std::filesystem::remove(file_, ignored);
    std::filesystem::remove(file_.string() + "-journal", ignored);
  }

  const std::filesystem::path file_;
  const bool was_there_;
  bool committed_ = false, mine_ = false;  // mine_: a new file, which nobody else has written
  Temporary new_, new_journal_;            // until it is committed
  std::unique_ptr<sqlite3, Close> db_;
};

}  // namespace

std::unique_ptr<Database> open_sqlite(const std::string& file, const char* schema) {
  return std::make_unique<Sqlite>(file, schema);
}

}  // namespace tribotwin::twin::diagnosis::fleet
