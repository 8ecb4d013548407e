#!/bin/bash
# One recording per task, with one lane per core of the task. Slurm decides how many tasks run at once.
#   sbatch --array=1-$(wc -l < recordings.txt) slurm.sh recordings.txt runs
# The same command again continues tasks that were stopped. Afterwards:
#   gepf evaluate runs/* --csv
#SBATCH --cpus-per-task=8
#SBATCH --mem=4G
#SBATCH --time=02:00:00
#SBATCH --requeue
#SBATCH --signal=TERM@60
set -euo pipefail
list=$1 runs=$2
recording=$(sed -n "${SLURM_ARRAY_TASK_ID}p" "$list")
name=$(basename "${recording%.*}")
exec gepf track "$recording" --out "$runs/$name" --resume --no-pictures --workers "$SLURM_CPUS_PER_TASK"
