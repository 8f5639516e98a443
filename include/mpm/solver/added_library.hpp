// A shared library of one material, opened and asked for it.
#pragma once

#include <dlfcn.h>

#include <string>

#include "mpm/core/error.hpp"

namespace mpm {

/// What `symbol` of the library at `path` returns for `host`. The library stays: scenes and engines
/// point at what it holds. Raises `SceneError` for a file that is none, or was compiled from other
/// headers.
template <class Added, class Get, class Host>
const Added& load_added(const std::string& path, const char* symbol, const Host& host) {
    const auto refuse = [&](void* library, const std::string& why) {
        if (library) ::dlclose(library);
        throw SceneError("the compiled material '" + path + "' " + why);
    };
    void* library = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (!library) {
        const char* why = ::dlerror();
        refuse(nullptr, std::string("cannot be loaded: ") + (why ? why : "no reason given"));
    }
    const auto get = reinterpret_cast<Get>(::dlsym(library, symbol));
    if (!get) refuse(library, std::string("exports no ") + symbol);
    const Added* added = get(&host);
    if (!(added->layout == host.layout))
        refuse(library, "was compiled from other headers than this library, " LIBMPM_VERSION
                        "; delete it and compile it anew");
    return *added;
}

}  // namespace mpm
