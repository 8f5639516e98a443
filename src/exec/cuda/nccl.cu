#include "nccl.hpp"

#include <dlfcn.h>

#include <cstdlib>

#include "mpm/core/error.hpp"

namespace mpm {

const Nccl& Nccl::open() {
    static const Nccl library;
    return library;
}

Nccl::Nccl() {
    // Multicast over NVLink is of no use to what goes from one to one, and takes memory.
    setenv("NCCL_NVLS_ENABLE", "0", 0);
    const char* asked = std::getenv("LIBMPM_NCCL");
    path_ = asked && *asked ? asked : "libnccl.so.2";
    const std::string remedy =
        ". Install nvidia-nccl-cu12 or nvidia-nccl-cu13 (by pip, for the CUDA of the driver), or "
        "name the file by LIBMPM_NCCL=/path/to/libnccl.so.2 or its folder by LD_LIBRARY_PATH. On "
        "the devices of one host none is needed: device=['cuda:0', 'cuda:1']";
    void* library = dlopen(path_.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        const char* why = dlerror();
        throw DeviceError(
            "NCCL, which ranks as processes on CUDA devices speak through, cannot be "
            "opened: '" +
            path_ + "' (" + (why ? why : "no reason given") + ")" + remedy);
    }
    const auto find = [&](auto& function, const char* name) {
        void* found = dlsym(library, name);
        if (!found)
            throw DeviceError("'" + path_ + "' has no " + name + " and is not NCCL" + remedy);
        function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(found);
    };
    find(get_version, "ncclGetVersion");
    find(get_unique_id, "ncclGetUniqueId");
    find(comm_init_rank, "ncclCommInitRank");
    find(comm_abort, "ncclCommAbort");
    find(comm_get_async_error, "ncclCommGetAsyncError");
    find(group_start, "ncclGroupStart");
    find(group_end, "ncclGroupEnd");
    find(send, "ncclSend");
    find(recv, "ncclRecv");
    find(get_error_string, "ncclGetErrorString");
    int version = 0;
    check(get_version(&version), "ncclGetVersion");
    if (version < least_version)
        throw DeviceError("'" + path_ + "' is version " + std::to_string(version) +
                          " of NCCL; needed is " + std::to_string(least_version) + " or later" +
                          remedy);
    find(get_last_error, "ncclGetLastError");
}

void Nccl::check(int code, const char* what, void* comm) const {
    if (code == success) return;
    const char* more = comm && get_last_error ? get_last_error(comm) : nullptr;
    throw DeviceError(std::string("NCCL: ") + get_error_string(code) + " (" + what +
                      (more && *more ? std::string(": ") + more : std::string()) + ", " + path_ +
                      "). NCCL_DEBUG=WARN says more");
}

}  // namespace mpm
