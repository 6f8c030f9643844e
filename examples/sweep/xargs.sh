#!/bin/sh
# xargs: as many shards at once as there are processors; nothing to install.
#   examples/sweep/xargs.sh STUDY.toml DIR SHARDS
set -eu
study=$1 out=$2 shards=$3
seq "$shards" | xargs -P "$(nproc)" -I{} ${STRIDEMAP:-stridemap} sweep "$study" --shard "{}/$shards" --out "$out"
exec ${STRIDEMAP:-stridemap} sweep merge "$out"
