#!/bin/sh
# sh run.sh STAGE FIRST COUNT: runs these lines of STAGE.commands, counted from 1, each with a log of its own.
# Ends with 0, with 3 where it was asked to stop and may be run again, or else with the status of the last that failed.
# USR1: stop soon, what is rendered is kept in a checkpoint. TERM is taken to have reached the command as well.
here=$(cd "$(dirname "$0")" && pwd)
folder=$(dirname "$(dirname "$here")")
stage=$1 first=$2 count=$3
tab=$(printf '\t')
child='' stop='' worst=0
trap 'stop=1; [ -z "$child" ] || kill -TERM "$child" 2>/dev/null' USR1
trap 'stop=1' TERM

# run NAME COMMAND
run() {
  log=$folder/logs/$1.log
  begun=$(date +%s)
  echo "brume task: begun in round $(basename "$here") on ${SLURMD_NODENAME:-$(uname -n)}" >>"$log"
  sh -c "$2" >>"$log" 2>&1 &
  child=$!
  wait "$child"
  status=$?
  while [ $status -gt 128 ] && kill -0 "$child" 2>/dev/null; do
    wait "$child"
    status=$?
  done
  child=''
  echo "brume task: ended with $status after $(($(date +%s) - begun)) s" >>"$log"
  return $status
}

line=$first
while [ "$line" -lt $((first + count)) ] && [ -z "$stop" ]; do
  text=$(sed -n "${line}p" "$here/$stage.commands")
  line=$((line + 1))
  [ -n "$text" ] || continue
  name=${text%%"$tab"*}
  if run "$name" "${text#*"$tab"}"; then
    # The part that completes a frame merges it; what is left is for the stage of that name.
    frame=${name#render.}
    merge=''
    [ "$stage" != render ] || [ ! -f "$here/merge.commands" ] || [ -f "$here/gather.commands" ] || \
      merge=$(grep "^merge.${frame%.*}$tab" "$here/merge.commands")
    [ -z "$merge" ] || sh -c "${merge#*"$tab"} --when-complete -q" >>"$log" 2>&1 || :
  else
    worst=$status
    # A node on which everything fails at once must not take all there is to do.
    [ -n "$stop" ] || sleep "${BRUME_PAUSE:-10}"
  fi
done
[ -z "$stop" ] || exit 3
exit $worst
