# SPDX-License-Identifier: Apache-2.0
# For a shell of `ontime lab --live --cpus 3`, where the controller cpuset is taken for control groups of version 1: a process
# that gives itself a CPU while CPU 2 is kept; and a machine on which all processes were started without CPU 2, as with
# isolcpus=2. See test_lab.py.
groups=/tmp/cpuset
mkdir $groups
busybox mount -t cgroup -o cpuset none $groups
scenario() {
  cat >/tmp/isolated.yaml <<YAML
hosts: namespaces
defaults: {transport: udp, duration: $2}
runs:
  - id: isolated
    isolation: {cpus: $1}
YAML
}
sleep 1000 &
bystander=$!
agents() { ps -eo pid=,args= | grep '[o]ntime agent' | sed 's/^ *//; s/ .*//'; }
cpus() { taskset -cp "$1" | sed 's/.*: //'; }
see() { echo "$1 bystander=$(cpus $bystander) groups=$(cd $groups && echo ontime-*)"; }
measure() { TERM=dumb ontime run --only-measure --cable eth0,eth1 --results "/tmp/$1" /tmp/isolated.yaml 2>&1; echo "$1 ended $?"; }

see before
scenario 2 '10 s'
measure whole &
until [ -n "$(agents)" ]; do sleep 0.1; done
see during
taskset -cp 1 $bystander
wait $!
see after
taskset -cp 0,1 1
scenario 1 '1 s'
measure inherited
scenario 2 '1 s'
measure free
see end
kill $bystander
