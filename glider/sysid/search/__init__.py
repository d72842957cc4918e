"""Which effects explain the flights?

signs: angles logged with the other sign. tracing: the search. subsets: the best of all
sets. fields, peaks: what has no name, and where it is largest. weighing: how sure?
"""
