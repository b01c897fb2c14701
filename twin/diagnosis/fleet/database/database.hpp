#pragma once

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>

/// One session with the database behind a fleet's store: a single transaction on tables that others cannot change
/// meanwhile. SQL that both databases understand: parameters are $1, $2, .. in the order of their first use. Throws
/// InputError where the name is wrong or names something else, std::runtime_error where the machine fails.
namespace tribotwin::twin::diagnosis::fleet {

/// A prepared statement.
class Statement {
 public:
  Statement() = default;
  Statement(const Statement&) = delete;
  virtual ~Statement() = default;

  /// Begins anew with these values: whole numbers, numbers (kept as NULL unless finite) and texts.
  template <class... T>
  Statement& operator()(const T&... values) {
    reset();
    int at = 0;
    (bind(++at, values), ...);
    return *this;
  }
  /// Whether there is a (further) row.
  virtual bool row() = 0;
  /// Runs a statement without a result, or leaves the rows that remain.
  void run() {
    while (row()) {
    }
  }
  /// NULL: 0, NaN, "". A real that is no number: NaN.
  virtual std::int64_t integer(int column) const = 0;
  virtual double real(int column) const = 0;
  virtual std::string text(int column) const = 0;

 private:
  void bind(int at, const std::optional<double>& x) { bind(at, x ? *x : std::numeric_limits<double>::quiet_NaN()); }
  virtual void reset() = 0;
  virtual void bind(int at, std::int64_t x) = 0;
  virtual void bind(int at, double x) = 0;
  virtual void bind(int at, const std::string& x) = 0;
};

class Database {
 public:
  Database() = default;
  Database(const Database&) = delete;
  virtual ~Database() = default;  ///< without commit(): all is as before

  /// Prepared once for each `sql`, which must outlive the session.
  Statement& statement(const char* sql) {
    auto& place = statements_[sql];
    if (!place) place = prepare(sql);
    return *place;
  }
  virtual void commit() = 0;
  /// A column of numbers, NULL in the rows that are there; nothing where the table has one of this name.
  virtual void add_column(const std::string& table, const std::string& column) = 0;

 protected:
  /// Before the session ends.
  void forget_statements() { statements_.clear(); }

 private:
  virtual std::unique_ptr<Statement> prepare(const char* sql) = 0;
  std::unordered_map<const char*, std::unique_ptr<Statement>> statements_;
};

/// Whether the name of a store is the URL of a database, and not a file.
bool is_url(std::string_view name);
/// The name as it may be printed: a URL without its password.
std::string without_password(std::string_view name);

/// Opens a database (is_url) or a file, and makes the tables of `schema` where there is nothing yet. `schema` is a
/// series of CREATE TABLE with the types INTEGER, REAL and TEXT; nothing is kept before commit().
std::unique_ptr<Database> open_database(const std::string& name, const char* schema);

/// Of one kind; the second throws InputError where the program was built without PostgreSQL.
std::unique_ptr<Database> open_sqlite(const std::string& file, const char* schema);
std::unique_ptr<Database> open_postgresql(const std::string& url, const char* schema);

}  // namespace tribotwin::twin::diagnosis::fleet
