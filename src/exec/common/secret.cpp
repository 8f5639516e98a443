#include "mpm/exec/secret.hpp"

#include <fcntl.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>

#include "mpm/core/error.hpp"

namespace mpm {

namespace {

struct File {
    int fd;
    explicit File(int f) : fd(f) {}
    File(const File&) = delete;
    File& operator=(const File&) = delete;
    ~File() {
        if (fd >= 0) ::close(fd);
    }
};

const char* how_to_make = "make one by `(umask 077; openssl rand -hex 32 > FILE)`";

/// What is wrong with who may read a file; "" where nothing is.
std::string open_to_others(const struct stat& about) {
    if (about.st_uid != ::geteuid() && about.st_uid != 0) return "belongs to another user";
    if (!S_ISREG(about.st_mode)) return "is no file";
    if ((about.st_mode & 077) != 0) return "can be read or written by others; chmod 600 it";
    return {};
}

std::string trimmed(const std::string& text) {
    const char* blank = " \t\r\n";
    const std::size_t first = text.find_first_not_of(blank);
    if (first == std::string::npos) return {};
    return text.substr(first, text.find_last_not_of(blank) - first + 1);
}

/// At most a byte more than a secret may have.
std::string content(int fd) {
    std::string text(most_secret + 1, '\0');
    std::size_t size = 0;
    while (size < text.size()) {
        const ssize_t n = ::read(fd, text.data() + size, text.size() - size);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) break;
        size += std::size_t(n);
    }
    text.resize(size);
    return text;
}

std::string checked(const std::string& name, const std::string& given) {
    const std::string text = trimmed(given);
    if (text.size() < least_secret || text.size() > most_secret)
        throw DeviceError("ranks as processes: the secret of " + name + " has " +
                          (text.size() > most_secret ? "more than " + std::to_string(most_secret)
                                                     : std::to_string(text.size())) +
                          " characters; expected " + std::to_string(least_secret) + " to " +
                          std::to_string(most_secret) + ": " + how_to_make);
    return text;
}

}  // namespace

std::string read_secret(const Environment& environment) {
    const char* text = environment("LIBMPM_SECRET");
    const char* path = environment("LIBMPM_SECRET_FILE");
    const bool has_text = text && *text, has_path = path && *path;
    if (has_text && has_path)
        throw DeviceError(
            "ranks as processes: LIBMPM_SECRET and LIBMPM_SECRET_FILE are both set; set one");
    if (has_text) return checked("LIBMPM_SECRET", text);
    if (!has_path) return {};
    const std::string name = "LIBMPM_SECRET_FILE '" + std::string(path) + "'";
    const File file(::open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK));
    struct stat about {};
    if (file.fd < 0 || ::fstat(file.fd, &about) != 0)
        throw DeviceError("ranks as processes: " + name +
                          " cannot be read: " + std::strerror(errno) + "; " + how_to_make +
                          " where all processes see it");
    const std::string wrong = open_to_others(about);
    if (!wrong.empty()) throw DeviceError("ranks as processes: " + name + " " + wrong);
    return checked(name, content(file.fd));
}

std::string random_digits(int bytes) {
    std::string out;
    while (out.size() < 2 * std::size_t(bytes)) {
        unsigned char byte = 0;
        const ssize_t n = ::getrandom(&byte, 1, 0);
        if (n < 0 && errno != EINTR)
            throw DeviceError(std::string("the system gives no random numbers: ") +
                              std::strerror(errno));
        if (n != 1) continue;
        out += "0123456789abcdef"[byte >> 4];
        out += "0123456789abcdef"[byte & 15];
    }
    return out;
}

SecretFile::SecretFile(const std::string& name) {
    // The same for all processes of this user on this host, whatever their environments say.
    const std::string folder = "/tmp/libmpm-" + std::to_string(long(::geteuid()));
    const auto fail = [&](const std::string& why) {
        throw DeviceError("ranks as processes: '" + folder +
                          "', where the processes of a job on one host share their secret, " + why +
                          ". Remove it, or set LIBMPM_SECRET or LIBMPM_SECRET_FILE");
    };
    if (::mkdir(folder.c_str(), 0700) != 0 && errno != EEXIST)
        fail(std::string("cannot be made: ") + std::strerror(errno));
    struct stat about {};
    if (::lstat(folder.c_str(), &about) != 0) fail(std::strerror(errno));
    if (!S_ISDIR(about.st_mode) || about.st_uid != ::geteuid() || (about.st_mode & 077) != 0)
        fail("is not a folder of this user alone");
    path_ = folder + "/" + name;
}

SecretFile::~SecretFile() {
    if (made_) ::unlink(path_.c_str());
}

std::string SecretFile::make() {
    const std::string secret = random_digits(32), draft = path_ + "." + random_digits(8);
    {
        const File file(
            ::open(draft.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, 0600));
        const ssize_t size = ssize_t(secret.size());
        if (file.fd < 0 || ::write(file.fd, secret.data(), secret.size()) != size ||
            ::rename(draft.c_str(), path_.c_str()) != 0) {
            const std::string why = std::strerror(errno);
            ::unlink(draft.c_str());
            throw DeviceError("ranks as processes: '" + path_ + "' cannot be written: " + why +
                              "; set LIBMPM_SECRET or LIBMPM_SECRET_FILE");
        }
    }
    made_ = true;
    return secret;
}

std::string SecretFile::read() const {
    const File file(::open(path_.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC | O_NONBLOCK));
    struct stat about {};
    if (file.fd < 0 || ::fstat(file.fd, &about) != 0 || !open_to_others(about).empty()) return {};
    const std::string text = content(file.fd);
    return text.size() < least_secret || text.size() > most_secret ? std::string() : text;
}

}  // namespace mpm
