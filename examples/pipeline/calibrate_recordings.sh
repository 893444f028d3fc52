#!/bin/sh
# Calibrate every recording in a folder, for a CI or a timer: one result for each, one table.
#
#   calibrate_recordings.sh RECORDINGS RESULTS
#
# Exit code 0: all are within the bound of calibrate.yaml. 1: one of them is not, or cannot be learned
# from; RESULTS/table.csv says which. 2: nothing was done.
set -eu
here=$(dirname "$0")
exec nico-selfmodel calibrate kinematics "${1:?folder of recordings}" --out "${2:?folder to make}" \
  --options "$here/calibrate.yaml" --processes "${PROCESSES:-2}" --force
