"""One image on many machines: passes are planned where its state is, run on the workers of a cluster, and added here.

    render process ──(Unix socket)──► gate, in the server ──(Dask)──► scheduler ──► worker ──► its render process

The state, the plan and the order in which results are added stay in this machine's render process, so bits are those of
one machine. It has no network, for it reads strangers' scenes; the gate has. A scene goes to a worker once, by its id.
What is lost is asked for again: a pass depends on nothing but what its message says.
"""
