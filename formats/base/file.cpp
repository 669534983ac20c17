// Whole files in, atomic files out (POSIX).
//
// Atomic means: at every moment `path` is either the old file or the complete new one, also after a crash or a full disk. Hence a
// temporary in the same folder (rename does not cross file systems), every byte written and synced, then renamed.
#include "base/file.h"

#include <algorithm>
#include <cerrno>
#include <charconv>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <memory>
#include <sys/stat.h>
#include <system_error>
#include <unistd.h>
#include <utility>

namespace nacre {
namespace {

constexpr const char* kTemporary = ".tmp-"; // then the process that writes it

/// Through a symbolic link: replace the file it points to, not the link.
std::string behindLinks(const std::string& path)
{
    const std::unique_ptr<char, void (*)(void*)> resolved(::realpath(path.c_str(), nullptr), std::free);
    return resolved ? resolved.get() : path;
}

std::string osText(int error) { return std::generic_category().message(error); }

/// Closes on scope exit. Writers close by hand first, because close() is where some file systems report a full disk.
struct Descriptor {
    int fd = -1;
    explicit Descriptor(int value) : fd(value) {}
    Descriptor(const Descriptor&) = delete;
    Descriptor& operator=(const Descriptor&) = delete;
    ~Descriptor()
    {
        if (fd >= 0) ::close(fd);
    }
    int close() { return ::close(std::exchange(fd, -1)); }
};

bool writeAll(int fd, std::span<const std::byte> bytes)
{
    while (!bytes.empty()) {
        const ssize_t n = ::write(fd, bytes.data(), bytes.size());
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return false;
        if (n == 0) {
            errno = ENOSPC;
            return false;
        }
        bytes = bytes.subspan(size_t(n));
    }
    return true;
}

Error writeError(const std::string& path, const std::string& what, int error)
{
    return Error{ErrorCode::kIo,
                 "cannot write '" + path + "': " + what + ": " + osText(error) +
                     (error == ENOSPC || error == EDQUOT || error == EFBIG ? "; free some space and run again" : "")};
}

/// A device or a pipe (/dev/stdout) has no old content to protect and must not be replaced by a file.
Status writeStraight(const std::string& path, std::span<const std::byte> bytes)
{
    Descriptor file(::open(path.c_str(), O_WRONLY | O_CLOEXEC));
    if (file.fd < 0) return writeError(path, "open", errno);
    if (!writeAll(file.fd, bytes)) return writeError(path, "write", errno);
    if (file.close() != 0) return writeError(path, "close", errno);
    return ok();
}

/// Makes the rename itself durable. Some file systems cannot sync a folder; the new file is complete all the same.
void syncFolderOf(const std::string& path)
{
    const size_t slash = path.rfind('/');
    const std::string folder = slash == std::string::npos ? "." : path.substr(0, slash + 1);
    Descriptor dir(::open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
    if (dir.fd >= 0) (void)::fsync(dir.fd);
}

} // namespace

Result<std::vector<std::byte>> readFile(const std::string& path, size_t maxBytes)
{
    const auto fail = [&](const std::string& why) { return Error{ErrorCode::kBadInput, "cannot read '" + path + "': " + why}; };
    Descriptor file(::open(path.c_str(), O_RDONLY | O_CLOEXEC));
    if (file.fd < 0) return fail(osText(errno));
    struct stat info = {};
    if (::fstat(file.fd, &info) != 0) return fail(osText(errno));
    if (S_ISDIR(info.st_mode)) return fail("it is a folder, a file is needed");

    const auto tooLarge = [&] { return fail("larger than the limit of " + std::to_string(maxBytes) + " bytes"); };
    if (S_ISREG(info.st_mode) && uint64_t(info.st_size) > maxBytes) return tooLarge();

    // st_size is a hint only: pipes have none and a file may grow while it is read.
    std::vector<std::byte> bytes(S_ISREG(info.st_mode) ? size_t(info.st_size) + 1 : size_t(1) << 16);
    size_t used = 0;
    for (;;) {
        if (used == bytes.size()) bytes.resize(2 * bytes.size());
        const ssize_t n = ::read(file.fd, bytes.data() + used, bytes.size() - used);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0) return fail(osText(errno));
        if (n == 0) break;
        used += size_t(n);
        if (used > maxBytes) return tooLarge();
    }
    bytes.resize(used);
    return bytes;
}

Result<FileStart> readFileStart(const std::string& path, size_t count)
{
    const auto fail = [&](const std::string& why) { return Error{ErrorCode::kBadInput, "cannot read '" + path + "': " + why}; };
    std::error_code ec;
    FileStart out;
    out.fileSize = size_t(std::filesystem::file_size(path, ec));
    if (ec) return fail(ec.message());
    std::ifstream file(path, std::ios::binary);
    if (!file) return fail("it cannot be opened");
    out.bytes.resize(std::min(count, out.fileSize));
    file.read(reinterpret_cast<char*>(out.bytes.data()), std::streamsize(out.bytes.size()));
    out.bytes.resize(size_t(file.gcount()));
    return out;
}

Status writeFileAtomically(const std::string& path, std::span<const std::byte> bytes)
{
    struct stat info = {};
    if (::stat(path.c_str(), &info) == 0) {
        if (S_ISDIR(info.st_mode)) return writeError(path, "it is a folder", EISDIR);
        if (!S_ISREG(info.st_mode)) return writeStraight(path, bytes);
    }

    const std::string target = behindLinks(path), temporary = target + kTemporary + std::to_string(::getpid());
    Descriptor file(::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0666));
    if (file.fd < 0) return writeError(path, "cannot create '" + temporary + "'", errno);
    const auto giveUp = [&](const char* what) {
        const int error = errno;
        ::unlink(temporary.c_str());
        return writeError(path, what, error);
    };
    if (!writeAll(file.fd, bytes)) return giveUp("write");
    if (::fsync(file.fd) != 0) return giveUp("sync");
    if (file.close() != 0) return giveUp("close");
    if (::rename(temporary.c_str(), target.c_str()) != 0) return giveUp("rename");
    syncFolderOf(target);
    return ok();
}

void removeAbandonedTemporaries(const std::string& path)
{
    const std::filesystem::path target = behindLinks(path), folder = target.has_parent_path() ? target.parent_path() : ".";
    const std::string start = target.filename().string() + kTemporary;
    std::error_code ec;
    for (std::filesystem::directory_iterator it(folder, ec), end; !ec && it != end; it.increment(ec)) {
        const std::string name = it->path().filename().string();
        if (!name.starts_with(start)) continue;
        const char *first = name.data() + start.size(), *last = name.data() + name.size();
        pid_t writer = 0;
        if (const auto parsed = std::from_chars(first, last, writer); parsed.ec != std::errc() || parsed.ptr != last || writer <= 0) continue;
        if (::kill(writer, 0) != 0 && errno == ESRCH) ::unlink(it->path().c_str());
    }
}

} // namespace nacre
