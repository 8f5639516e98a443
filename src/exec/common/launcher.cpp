#include "mpm/exec/launcher.hpp"

#include <unistd.h>

#include <cstdint>
#include <cstdlib>

#include "mpm/core/error.hpp"
#include "mpm/exec/secret.hpp"

namespace mpm {

namespace {

/// Ports that follow from a job lie between those of services and those that systems give away.
constexpr int first_port = 20000, ports = 12000;

class Reader {
public:
    explicit Reader(const Environment& environment) : environment_(environment) {}

    /// The value of a variable, kept for messages; "" where it is not set or empty.
    std::string text(const std::string& name) {
        const char* value = environment_(name.c_str());
        if (!value || !*value) return {};
        const std::string entry = name + "=" + value;
        if (read_.find(entry) == std::string::npos) read_ += (read_.empty() ? "" : ", ") + entry;
        return value;
    }
    bool has(const std::string& name) const {
        const char* value = environment_(name.c_str());
        return value && *value;
    }
    int number(const std::string& name, int least, int most) {
        const std::string value = text(name);
        std::size_t used = 0;
        long n = least - 1;
        try {
            n = std::stol(value, &used);
        } catch (const std::exception&) {
            used = 0;
        }
        if (value.empty() || used != value.size() || n < least || n > most)
            throw DeviceError("ranks as processes: " + name + " is '" + value +
                              "'; expected a whole number from " + std::to_string(least) + " to " +
                              std::to_string(most) +
                              (read_.empty() ? "" : " (read: " + read_ + ")"));
        return int(n);
    }
    const std::string& read() const { return read_; }

private:
    const Environment& environment_;
    std::string read_;
};

/// Most processes of a job: each is connected to each.
constexpr int most_processes = 1024;

int port_of(const std::string& job) {
    std::uint32_t hash = 2166136261u;  // FNV-1a
    for (const unsigned char c : job) hash = (hash ^ c) * 16777619u;
    return first_port + int(hash % std::uint32_t(ports));
}

/// "host:port", the host perhaps an address in brackets.
void read_place(const std::string& name, const std::string& value, Launch& to) {
    const std::size_t colon = value.rfind(':');
    std::string host = value.substr(0, colon == std::string::npos ? 0 : colon);
    if (host.size() > 2 && host.front() == '[' && host.back() == ']')
        host = host.substr(1, host.size() - 2);
    const std::string port = colon == std::string::npos ? "" : value.substr(colon + 1);
    const bool digits = !port.empty() && port.size() < 6 &&
                        port.find_first_not_of("0123456789") == std::string::npos;
    if (host.empty() || !digits || std::stoi(port) < 1 || std::stoi(port) > 65535)
        throw DeviceError("ranks as processes: " + name + " is '" + value +
                          "'; expected host:port, such as node01:29400");
    to.host = host;
    to.port = std::stoi(port);
}

}  // namespace

std::string first_host(const std::string& list) {
    const std::size_t end = list.find_first_of(",[");
    std::string host = list.substr(0, end);
    if (end == std::string::npos || list[end] != '[') return host;
    const std::size_t close = list.find(']', end);
    if (close == std::string::npos) return {};
    const std::string inside = list.substr(end + 1, close - end - 1);
    host += inside.substr(0, inside.find_first_of(",-"));
    // What follows the brackets, up to the next host.
    return host + list.substr(close + 1, list.find(',', close) - close - 1);
}

Launch read_launch(const Environment& environment) {
    Reader env(environment);
    Launch out;
    std::string size_name;
    bool one_host = true;  // as far as the launcher tells
    bool sure = false;     // and it tells
    const auto take = [&](const std::string& launcher, const std::string& rank,
                          const std::string& size) {
        out.launcher = launcher;
        out.ranks = env.number(size, 1, most_processes);
        out.rank = env.number(rank, 0, out.ranks - 1);
    };
    const auto local = [&](const std::string& name) {
        sure = env.has(name);
        one_host = !sure || env.number(name, 1, most_processes) == out.ranks;
    };
    // Of one job on one host all processes have the same parent, unless shells stand between.
    const std::string parent = "parent " + std::to_string(long(getppid()));
    const auto job_of = [&](std::initializer_list<const char*> names) {
        for (const char* name : names) out.job += env.text(name) + "/";
        if (out.job.find_first_not_of('/') == std::string::npos) out.job = parent;
    };
    if (env.has("RANK") && env.has("WORLD_SIZE")) {
        take("torchrun", "RANK", "WORLD_SIZE");
        local("LOCAL_WORLD_SIZE");
        out.job = env.text("TORCHELASTIC_RUN_ID");
        if (!env.has("LIBMPM_MASTER") && (!env.has("MASTER_ADDR") || !env.has("MASTER_PORT")))
            throw DeviceError(
                "ranks as processes: RANK and WORLD_SIZE are set, MASTER_ADDR and MASTER_PORT are "
                "not; set both, or LIBMPM_MASTER=host:port (read: " +
                env.read() + ")");
    } else if (env.has("OMPI_COMM_WORLD_RANK")) {
        take("Open MPI", "OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE");
        local("OMPI_COMM_WORLD_LOCAL_SIZE");
        job_of({"PMIX_NAMESPACE", "OMPI_MCA_ess_base_jobid"});
    } else if (env.has("PMI_RANK")) {
        take("MPICH", "PMI_RANK", "PMI_SIZE");
        local("MPI_LOCALNRANKS");
        job_of({"PMI_JOBID"});
    } else if (env.has("SLURM_PROCID")) {
        take("Slurm", "SLURM_PROCID",
             env.has("SLURM_STEP_NUM_TASKS") ? "SLURM_STEP_NUM_TASKS" : "SLURM_NTASKS");
        job_of({"SLURM_JOB_ID", "SLURM_STEP_ID"});
        const std::string nodes = env.text("SLURM_STEP_NODELIST");
        one_host = !nodes.empty();
        if (one_host) out.host = first_host(nodes);
        if (one_host && out.host.empty())
            throw DeviceError("ranks as processes: SLURM_STEP_NODELIST is '" + nodes +
                              "', which is no list of hosts; set LIBMPM_MASTER=host:port");
        sure = one_host && nodes.find_first_of(",[") == std::string::npos;
    } else {
        return out;
    }
    if (env.has("LIBMPM_MASTER")) {
        read_place("LIBMPM_MASTER", env.text("LIBMPM_MASTER"), out);
    } else if (env.has("MASTER_ADDR") && env.has("MASTER_PORT")) {
        // A launcher names its host by whatever name it has, even to processes that share it.
        const std::string host = env.text("MASTER_ADDR");
        if (!(sure && one_host)) out.host = host;
        out.port = env.number("MASTER_PORT", 1, 65535);
        // The launcher keeps a service of its own at that port.
        if (env.text("TORCHELASTIC_USE_AGENT_STORE") == "True")
            out.port += out.port < 65535 ? 1 : -1;
    } else if (!one_host && out.ranks > 1) {
        throw DeviceError("ranks as processes: " + out.launcher +
                          " runs this job on several hosts and does not say which has rank 0; set "
                          "LIBMPM_MASTER=host:port for all processes (read: " +
                          env.read() + ")");
    } else {
        if (sure && one_host) out.host = Launch().host;
        out.port = port_of(out.job);
    }
    out.one_host = sure && one_host;
    out.listen = env.text("LIBMPM_LISTEN");
    if (out.ranks > 1) out.secret = read_secret(environment);  // and not among what is told
    out.read = env.read();
    return out;
}

Launch read_launch() {
    return read_launch([](const char* name) -> const char* { return std::getenv(name); });
}

}  // namespace mpm
