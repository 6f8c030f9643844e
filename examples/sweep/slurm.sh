#!/bin/sh
#SBATCH --job-name=stridemap
#SBATCH --cpus-per-task=1
#SBATCH --requeue
# Slurm: one array task a shard, in a directory that the nodes share.
#   sbatch --array=1-64 examples/sweep/slurm.sh STUDY.toml DIR; then stridemap sweep merge DIR
set -eu
exec ${STRIDEMAP:-stridemap} sweep "$1" --shard "$SLURM_ARRAY_TASK_ID/$SLURM_ARRAY_TASK_COUNT" --out "$2"
