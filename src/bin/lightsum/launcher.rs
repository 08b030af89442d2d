//! Whether a launcher of MPI jobs started this program.

/// The number of ranks of the job, as Open MPI, MPICH or Slurm's launcher tells; `None`: none of them started it.
pub fn ranks() -> Option<usize> {
    ranks_by(|name| std::env::var(name).ok())
}

fn ranks_by(variable: impl Fn(&str) -> Option<String>) -> Option<usize> {
    let own = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE"].into_iter().find_map(&variable);
    // Slurm names the size of a step whether or not it speaks the protocol of MPI.
    let of_slurm = || variable("PMIX_RANK").and_then(|_| variable("SLURM_STEP_NUM_TASKS"));
    own.or_else(of_slurm)?.parse().ok()
}

/// Whether this is the first rank of a job, or none.
pub fn is_first() -> bool {
    let own = ["OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"].into_iter().find_map(|name| std::env::var(name).ok());
    own.is_none_or(|rank| rank == "0")
}

/// Why a program without MPI does nothing on several ranks.
#[cfg(any(test, not(feature = "mpi")))]
pub fn without_mpi(ranks: usize) -> lightsum::Error {
    let message = format!(
        "{ranks} ranks were started, and this program is built without MPI: each would render all of the image; build it with \
         --features mpi, or render parts by --shard (docs/cluster.md)"
    );
    lightsum::Error::Setting { name: "mpirun", message }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_without_mpi_tells_what_to_do() {
        let message = without_mpi(4).to_string();
        assert!(
            ["mpirun", "4 ranks", "--features mpi", "--shard"].iter().all(|word| message.contains(word)),
            "{message}"
        );
    }

    #[test]
    fn launchers_are_known_by_their_variables() {
        let of = |set: &[(&str, &str)]| {
            ranks_by(|name| set.iter().find(|(own, _)| *own == name).map(|(_, value)| String::from(*value)))
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("OMPI_COMM_WORLD_SIZE", "4")]), Some(4));
        assert_eq!(of(&[("PMI_SIZE", "2")]), Some(2));
        assert_eq!(of(&[("SLURM_STEP_NUM_TASKS", "3")]), None);
        assert_eq!(of(&[("SLURM_STEP_NUM_TASKS", "3"), ("PMIX_RANK", "0")]), Some(3));
    }
}
