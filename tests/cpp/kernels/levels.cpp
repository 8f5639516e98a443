// Two promises of the portable build: the passes over particles exist for wide vectors too, and
// nothing in the library turns on flushing of denormal numbers.
#include <gtest/gtest.h>
#include <omp.h>

#include <cstdio>
#include <limits>
#include <string>
#include <vector>

#include "mpm/kernels/cpu/levels.hpp"
#include "support/scene.hpp"

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

namespace mpm {
namespace {

#if MPM_HAS_LEVELS
std::vector<std::string> lines_of(const std::string& command) {
    std::vector<std::string> out;
    std::FILE* pipe = popen(command.c_str(), "r");
    if (!pipe) return out;
    char line[65536];
    while (std::fgets(line, sizeof line, pipe)) out.emplace_back(line);
    if (pclose(pipe) != 0) out.clear();
    return out;
}

/// The fused pass for one level: how many lines name each kind of register.
struct Registers {
    int ymm = 0, zmm = 0, fma = 0, lines = 0;
};
Registers registers_of(const std::string& function) {
    Registers r;
    for (const auto& symbol : lines_of("nm --defined-only " MPM_CPU_LIBRARY " 2>/dev/null")) {
        // <function><BlockPass<..., Stage::fused, ...>> or its <function>, of the first material.
        const std::string name_in = std::to_string(function.size()) + function;
        if ((symbol.find(name_in + "I") == std::string::npos &&
             symbol.find(name_in + "E") == std::string::npos) ||
            symbol.find("StageE0E") == std::string::npos) {
            continue;
        }
        std::string name = symbol.substr(symbol.rfind(' ') + 1);
        name.erase(name.find_last_not_of("\r\n") + 1);
        for (const auto& line :
             lines_of("objdump --no-show-raw-insn --disassemble='" + name + "' " MPM_CPU_LIBRARY)) {
            ++r.lines;
            r.ymm += line.find("%ymm") != std::string::npos;
            r.zmm += line.find("%zmm") != std::string::npos;
            r.fma += line.find("vfmadd") != std::string::npos;
        }
        break;
    }
    return r;
}

TEST(Levels, use_the_vectors_they_are_for) {
    if (lines_of("objdump --version 2>/dev/null").empty())
        GTEST_SKIP() << "objdump is not installed";
    const Registers v3 = registers_of("run_at_v3");
    ASSERT_GT(v3.lines, 100) << "no pass for x86-64-v3 in " MPM_CPU_LIBRARY;
    EXPECT_GT(v3.ymm, 500);
    EXPECT_GT(v3.fma, 100);
    EXPECT_EQ(v3.zmm, 0);
    const Registers v4 = registers_of("run_at_v4");
    ASSERT_GT(v4.lines, 100) << "no pass for x86-64-v4";
    EXPECT_GT(v4.ymm + v4.zmm, 500);
    // Negative control: the pass for any processor has none of it, nor has its step of a particle.
    for (const char* name : {"run_at_base", "alone"}) {
        const Registers any = registers_of(name);
        ASSERT_GT(any.lines, 100) << name;
        EXPECT_EQ(any.ymm + any.zmm + any.fma, 0) << name;
    }
}
#endif

template <class T>
T quarter(T x) {
    volatile T in = x;
    volatile T out = in / 4;
    return out;
}

bool denormals_live() {
    bool live = quarter(std::numeric_limits<float>::min()) > 0 &&
                quarter(std::numeric_limits<double>::min()) > 0;
#if defined(__x86_64__)
    live = live && (_mm_getcsr() & 0x8040u) == 0;  // flush to zero, denormals are zero
#endif
    return live;
}

TEST(Denormals, survive_loading_and_running_the_library) {
    ASSERT_TRUE(denormals_live()) << "already off before the engine ran: linked with fast-math";
    for (bool single : {true, false}) {
        Spec s = test::busy_scene(2, single);
        s.threads = 4;
        const auto e = make_cpu_engine(s);
        EXPECT_EQ(e->run(3, test::forever, test::forever).reason, "steps");
        EXPECT_TRUE(denormals_live());
        int dead = 0;
#pragma omp parallel num_threads(4) reduction(+ : dead)
        dead += denormals_live() ? 0 : 1;
        EXPECT_EQ(dead, 0) << "off in a worker";
    }
}

}  // namespace
}  // namespace mpm
