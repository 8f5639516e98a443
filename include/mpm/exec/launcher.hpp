// Which of how many processes this one is, and where they meet: what a launcher (torchrun, Open
// MPI, MPICH, Slurm) says in the environment.
#pragma once

#include <functional>
#include <string>
#include <vector>

namespace mpm {

/// A variable of the environment, or null.
using Environment = std::function<const char*(const char*)>;

struct Launch {
    std::string launcher;  // "" where none has started this process
    int rank = 0, ranks = 1;
    std::string host = "127.0.0.1";  // of rank 0
    int port = 0;
    std::string job;     // the same for all processes of a job
    std::string read;    // what was read, for messages: "RANK=1, WORLD_SIZE=4"
    std::string secret;  // of LIBMPM_SECRET or LIBMPM_SECRET_FILE; "": none was given
    std::string listen;  // LIBMPM_LISTEN: the address that rank 0 listens at, else that of `host`
    bool one_host = false;  // the launcher says that all processes are on this host
};

/// Reads, in this order: RANK and WORLD_SIZE (torchrun), OMPI_COMM_WORLD_*, PMI_* (MPICH, Intel
/// MPI), SLURM_*. Rank 0 listens at LIBMPM_MASTER ("host:port"); else on the loopback interface
/// where all are on one host; else at MASTER_ADDR, or on the first host of the Slurm step. The port
/// is MASTER_PORT, or one that follows from the job. Throws DeviceError where the variables
/// contradict themselves, or where it cannot be told which host rank 0 has.
Launch read_launch(const Environment& environment);
/// The same from the environment of this process.
Launch read_launch();

/// The first host of a list as Slurm writes it: "node[07-09,12],login1" -> "node07".
std::string first_host(const std::string& list);

}  // namespace mpm
