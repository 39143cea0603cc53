# SPDX-License-Identifier: Apache-2.0
# For a shell of `ontime lab`: runs over a VLAN by each of the transports that $TRANSPORTS names, with other traffic beside
# them, and what rules of nftables' at the other card see of the classes (PCP) of their frames. See test_lab.py.
{
  echo "hosts: namespaces"
  echo "wire: {vlan: 5}"
  echo "defaults: {duration: 1 s, realtime: on, traffic: {rate: 1 Mbit/s}, link: {message-priority: 6, traffic-priority: 2}}"
  echo "runs:"
  for transport in $TRANSPORTS; do echo "  - {id: $transport, transport: $transport}"; done
} >/tmp/classes.yaml
inside() { ip netns exec ontime-component "$@"; }
see() { inside nft list table netdev seen | awk -v id="$1" '/counter/ {name = $2} /packets/ {print id, name "=" $2}'; }
for transport in $TRANSPORTS; do
  messages="vlan type ip udp dport != 5201-5202 udp sport != 5201-5202"
  [ $transport = ethernet ] && messages="vlan type 0x88b5"
  {
    TERM=dumb ontime run --only-measure --cable eth0,eth1 --only $transport --results /tmp/$transport /tmp/classes.yaml 2>&1
    echo "$transport ended $?"
  } &
  until ps -eo args | grep -q '[o]ntime agent'; do sleep 0.1; done
  inside nft "table netdev seen {
    counter messages_6 { }; counter messages_other { }; counter traffic_2 { }; counter traffic_other { };
    chain coming { type filter hook ingress device \"eth1\" priority -600;
      $messages vlan pcp 6 counter name messages_6;
      $messages vlan pcp != 6 counter name messages_other;
      vlan type ip udp dport 5201-5202 vlan pcp 2 counter name traffic_2;
      vlan type ip udp dport 5201-5202 vlan pcp != 2 counter name traffic_other; }
  }"
  while ps -eo args | grep -q '[o]ntime agent'; do see $transport; sleep 0.2; done
  wait
done
