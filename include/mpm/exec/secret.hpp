// The secret of a launch: what the processes of a job know and nobody else.
#pragma once

#include <string>

#include "mpm/exec/launcher.hpp"

namespace mpm {

/// Fewer characters could be guessed: 32 hexadecimal digits are 128 bits.
inline constexpr std::size_t least_secret = 32, most_secret = 4096;

/// LIBMPM_SECRET, or the content of the file LIBMPM_SECRET_FILE, which must be this user's (or the
/// system's) and nobody else's to read; "" where neither is set. Throws DeviceError where both are,
/// or where it is too short.
std::string read_secret(const Environment& environment);

/// As many bytes of the system's, as hexadecimal digits.
std::string random_digits(int bytes);

/// The secret of a job on one host whose user has given none: rank 0 makes it, in a file that this
/// user alone can read, where the other ranks look for it. It is gone when they have met.
class SecretFile {
public:
    /// `name`: the same for all processes of the job. Throws DeviceError where the folder is
    /// another's.
    explicit SecretFile(const std::string& name);
    SecretFile(const SecretFile&) = delete;
    SecretFile& operator=(const SecretFile&) = delete;
    ~SecretFile();

    /// Of rank 0: a new secret, in place of what a job before may have left.
    std::string make();
    /// Of the others: "" where there is none yet. What a job before has left is no secret of this
    /// one: who is refused with it reads again.
    std::string read() const;
    const std::string& path() const { return path_; }

private:
    std::string path_;
    bool made_ = false;
};

}  // namespace mpm
