// NVIDIA's library of messages between devices, opened at run time: nothing is linked, and who runs
// one process needs none. Declared here is what is used of it (NCCL 2.14 and later).
#pragma once

#include <cuda_runtime.h>

#include <cstddef>
#include <string>

namespace mpm {

class Nccl {
public:
    struct Id {
        char bytes[128];
    };
    static constexpr int success = 0, in_progress = 7;
    static constexpr int bytes = 0;  // ncclInt8
    static constexpr int least_version = 21400;

    /// Opens LIBMPM_NCCL, or else libnccl.so.2 where the system finds it; once in a process. Throws
    /// DeviceError, which says what was looked for.
    static const Nccl& open();

    int (*get_version)(int*);
    int (*get_unique_id)(Id*);
    int (*comm_init_rank)(void**, int, Id, int);
    int (*comm_abort)(void*);
    int (*comm_get_async_error)(void*, int*);
    int (*group_start)();
    int (*group_end)();
    int (*send)(const void*, std::size_t, int, int, void*, cudaStream_t);
    int (*recv)(void*, std::size_t, int, int, void*, cudaStream_t);
    const char* (*get_error_string)(int);
    const char* (*get_last_error)(void*);

    /// Throws DeviceError unless `code` is success.
    void check(int code, const char* what, void* comm = nullptr) const;

private:
    Nccl();
    std::string path_;
};

}  // namespace mpm
