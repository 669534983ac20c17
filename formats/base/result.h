// Errors as values. Libraries return Result<T> and never print, throw across a module border or exit.
#pragma once

#include <cassert>
#include <string>
#include <utility>
#include <variant>

namespace nacre {

enum class ErrorCode {
    kBadInput,    // the user's file or argument is wrong: exit code 2
    kIo,          // the world failed while working (disk full, no permission): exit code 1
    kUnsupported, // well-formed, but not handled by this build: exit code 2
    kGpu,         // no context, out of GPU memory, shader failure: exit code 1
    kCancelled,   // Ctrl-C or SIGTERM
};

/// One line for a person: what was found, what was expected, where, what to try.
struct Error {
    ErrorCode code = ErrorCode::kBadInput;
    std::string message;
};

/// Either a value or an Error. `if (!r) return r.error();`
template <class T>
class [[nodiscard]] Result {
public:
    Result(T value) : state_(std::move(value)) {}
    Result(Error error) : state_(std::move(error)) {}
    explicit operator bool() const { return std::holds_alternative<T>(state_); }
    T& operator*() { assert(*this); return std::get<T>(state_); }
    const T& operator*() const { assert(*this); return std::get<T>(state_); }
    T* operator->() { return &**this; }
    const T* operator->() const { return &**this; }
    const Error& error() const { return std::get<Error>(state_); }

private:
    std::variant<T, Error> state_;
};

/// Success or an Error, for functions that return nothing.
using Status = Result<std::monostate>;
inline Status ok() { return std::monostate{}; }

} // namespace nacre
