#!/bin/bash
# A recording a task, as many at once as Slurm has room for; each has all the cores of its task as lanes.
#   sbatch --array=1-$(wc -l < recordings.txt) slurm.sh recordings.txt runs
# Tasks that were stopped go on where they were when the same line is typed again. Afterwards:
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
