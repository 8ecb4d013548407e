#!/bin/bash
# One recording per task, one lane per core. The list has one recording per line, the results go to runs/.
#   sbatch --array=0-$(($(wc -l < list.txt) - 1)) slurm.sh list.txt runs
# The same command again continues tasks that were stopped, and skips those that are done. Finally,
#   gepf track --list list.txt --out runs --no-pictures     # tracks what is missing, and writes runs/runs.csv
#SBATCH --cpus-per-task=8
#SBATCH --mem=4G
#SBATCH --time=02:00:00
#SBATCH --requeue
#SBATCH --signal=TERM@60
set -euo pipefail
exec gepf track --list "$1" --index "$SLURM_ARRAY_TASK_ID" --out "$2" --no-pictures \
    --workers "$SLURM_CPUS_PER_TASK"
