# gnuplot -e "folder='docs/results'" tests/bench/growth.gp: plots growth.csv as growth.png.
set datafile separator ','
set terminal pngcairo noenhanced size 1200,900
set output folder.'/growth.png'
data = folder.'/growth.csv'
set key above horizontal font ",9"
set logscale y
set ylabel 'ns a lenslet'
set grid
set multiplot layout 2,2 title 'Cost of a map, one thread'
of(name, x, y) = (strcol(1) eq name ? column(y) : NaN)
do for [panel = 1:4] {
    name = word('lenslets bins lit noise', panel)
    if (name eq 'lit') { name = 'lit bins' }
    column_x = panel == 1 ? 2 : panel == 2 ? 3 : panel == 3 ? 4 : 5
    set xlabel word('"lenslets a side" "bins a side" "lit bins a lenslet" "read noise, DN"', panel)
    if (panel == 1) { set logscale x 2 } else { unset logscale x }
    plot for [c = 6:9] data using column_x:(of(name, column_x, c)) with linespoints pt 7 title word('emd chi2 jacobian-frobenius verdict', c - 5)
}
unset multiplot
