#!/bin/sh
# Makes every log of this folder from its scene; the same version of lidarcli makes the same bytes.
set -eu
cd "$(dirname "$0")"
python=${PYTHON:-python}
simulate() {
    "$python" -m lidarcli simulate "$@" --overwrite
}
simulate room.toml -o room.mcap
simulate room_empty.toml -o room_empty.mcap --seed 1
simulate corridor.toml -o corridor.bag --compression lz4
simulate hall.toml -o hall
simulate people.toml -o people.csv.gz
simulate drive.toml -o drive.db3
simulate reflectors.toml -o reflectors.mcap
(cd .. && "$python" -m tools.two_lasers)
