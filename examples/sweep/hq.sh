#!/bin/sh
# HyperQueue: one task a shard, on whatever workers there are. A shard whose worker is lost is begun again elsewhere.
#   hq server start & hq worker start &
#   examples/sweep/hq.sh STUDY.toml DIR SHARDS
set -eu
study=$1 out=$2 shards=$3
hq submit --array "1-$shards" --cpus 1 --crash-limit 20 --wait --stdout none --stderr none \
  sh -c "exec ${STRIDEMAP:-stridemap} sweep '$study' --shard \"\$HQ_TASK_ID/$shards\" --out '$out'"
exec ${STRIDEMAP:-stridemap} sweep merge "$out"
