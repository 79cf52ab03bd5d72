# sums.awk - adds up the lines "passed failed skipped" that tap.awk left; a program that left none (expected: how many
# there are) has failed.
{
    passed += $1
    failed += $2
    skipped += $3
}
END {
    failed += expected - NR
    printf "%d passed, %d failed, %d skipped\n", passed, failed, skipped
    exit failed > 0
}
